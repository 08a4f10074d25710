"""Compiled proofs that cells of joint space are free: kinematics, sphere covers, separating axes, trees, shortcuts."""
