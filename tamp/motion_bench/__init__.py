"""Motion planning on MotionBenchMaker's problems: what is planned, by whom, and how long it takes."""
