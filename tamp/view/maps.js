"use strict";
(() => {
  const data = JSON.parse(document.getElementById("bipre-maps-data").textContent);
  const part = (name) => document.getElementById(`bipre-maps-${name}`);
  const canvas = part("canvas"), pen = canvas.getContext("2d"), select = part("select"), stretch = part("stretch");
  const WIDTH = canvas.width, HEIGHT = canvas.height, START = { turn: data.turn, tilt: data.tilt, zoom: 1 };
  let seen = { ...START };

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

  const colour = (share) => {
    const at = Math.min(Math.max(share, 0), 1) * (data.ramp.length - 1);
    const low = Math.min(Math.floor(at), data.ramp.length - 2);
    return data.ramp[low].map((value, k) => Math.round(value + (at - low) * (data.ramp[low + 1][k] - value)));
  };

  /* A function from a world point to [x, y, nearness] on the canvas, and its pixels for a metre. */
  const camera = (view) => {
    const [ct, st, ce, se] = [Math.cos(seen.turn), Math.sin(seen.turn), Math.cos(seen.tilt), Math.sin(seen.tilt)];
    const right = [-st, ct, 0], up = [-se * ct, -se * st, ce], eye = [ce * ct, ce * st, se];
    const scale = (seen.zoom * 0.47 * Math.min(WIDTH, HEIGHT)) / view.radius;
    const place = (spot) => {
      const from = spot.map((value, k) => value - view.centre[k]);
      return [WIDTH / 2 + scale * dot(from, right), HEIGHT / 2 - scale * dot(from, up), dot(from, eye)];
    };
    return [place, scale];
  };

  const stroke = (spots, ink, width) => {
    pen.strokeStyle = ink;
    pen.lineWidth = width;
    pen.beginPath();
    spots.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
  };

  /* Which scores have the first and the last colour. */
  const span = (view) => (stretch.checked && view.most > view.least ? [view.least, view.most] : [0, 1]);

  const draw = () => {
    const view = data.views[select.value], [place, scale] = camera(view), [low, high] = span(view);
    pen.clearRect(0, 0, WIDTH, HEIGHT);
    pen.lineJoin = pen.lineCap = "round";
    stroke([...data.table, data.table[0]].map(place), "#c9c4b8", 2);
    const spots = view.points.map(place), radius = Math.max(2.5, 0.0022 * scale);
    for (const k of spots.map((_, k) => k).sort((a, b) => spots[a][2] - spots[b][2])) {
      pen.fillStyle = `rgb(${view.scores ? colour((view.scores[k] - low) / (high - low)) : view.colours[k]})`;
      pen.beginPath();
      pen.arc(spots[k][0], spots[k][1], radius, 0, 2 * Math.PI);
      pen.fill();
    }
    for (let k = view.hands.length - 1; k >= 0; k--) {
      const line = view.hands[k].line.map(place), ink = k ? data.other : data.best;
      stroke(line, "#fff", k ? 5 : 10);
      stroke(line, ink, k ? 2.5 : 6);
      const [x, y] = [0, 1].map((axis) => (line[1][axis] + line[2][axis]) / 2);
      pen.font = `${k ? "" : "bold "}22px system-ui, sans-serif`;
      pen.strokeStyle = "#fff";
      pen.lineWidth = 5;
      pen.strokeText(String(k + 1), x + 8, y - 8);
      pen.fillStyle = ink;
      pen.fillText(String(k + 1), x + 8, y - 8);
    }
  };

  /* What stands below the drawing: the legend and the list of hands. */
  const tell = () => {
    const view = data.views[select.value], [low, high] = span(view);
    part("legend").hidden = !view.scores;
    part("low").textContent = low.toFixed(2);
    part("high").textContent = high.toFixed(2);
    const hands = view.hands.map((hand, k) => `${k + 1}: ${hand.score}`).join("   ");
    part("hands").textContent = hands ? `hands, best first   ${hands}` : "";
    draw();
  };

  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    seen.turn -= event.movementX * 0.01;
    seen.tilt = Math.min(Math.max(seen.tilt + event.movementY * 0.01, -1.5), 1.5);
    draw();
  });
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    seen.zoom = Math.min(Math.max(seen.zoom * Math.exp(-0.001 * event.deltaY), 0.3), 12);
    draw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { seen = { ...START }; draw(); });
  select.addEventListener("change", tell);
  stretch.addEventListener("change", tell);
  part("bar").style.background = `linear-gradient(90deg, ${data.ramp.map((rgb) => `rgb(${rgb})`).join(", ")})`;
  tell();
})();
