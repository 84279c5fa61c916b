// Moves through a run by slider, arrow keys, play button, or a click on a curve. draw.js draws.
(() => {
  const player = document.getElementById("player");
  const data = JSON.parse(document.getElementById("play").textContent);
  const {time, scenes, colours} = data, last = time.length - 1;
  const [slider, button] = [player.querySelector("input"), player.querySelector("button")];
  const field = player.querySelector(".field canvas");
  const stateOf = time.map((_, row) => wordAt(data.states, row));
  const drawn = [];  // what each curve's canvas shows: from its pixels to times
  let row = 0, frame = null;

  // The word of a list of [first row, word] that holds in a row.
  function wordAt(runs, row) {
    return runs[lastIndex(runs, ([first]) => first <= row)][1];
  }

  // Index of the last element up to which a condition holds, 0 if it holds for none.
  function lastIndex(values, holds) {
    let low = 0, high = values.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (holds(values[middle])) low = middle;
      else high = middle;
    }
    return low;
  }

  for (const scene of scenes) {
    if (!scene.picture) continue;
    scene.image = new Image();
    scene.image.onload = () => {
      scene.size = [scene.image.naturalWidth, scene.image.naturalHeight];
      draw();
    };
    scene.image.src = scene.picture;
  }

  const canvases = data.curves.map((curve, number) => {
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${curve.label} over time`);
    player.querySelector(".curves").append(canvas);
    const point = (event) => {
      play(false);
      go(rowAt(drawn[number].timeAt(event.clientX - canvas.getBoundingClientRect().left)));
    };
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); point(event); };
    canvas.onpointermove = (event) => { if (event.buttons) point(event); };
    return canvas;
  });

  function draw() {
    data.curves.forEach((curve, number) => {
      const options = {cursor: time[row], label: curve.label, foot: number === data.curves.length - 1};
      drawn[number] = drawCurve(canvases[number], {time, state: stateOf, ...curve}, colours, options);
    });
    const scene = shownScene();
    if (scene && scene.size) drawMarkers(field, scene, scene.image, colours);
  }

  // The last frame up to now that has markers.
  function shownScene() {
    return scenes[lastIndex(scenes, (scene) => scene.row <= row)];
  }

  function describe() {
    const {angle, low, high} = data.curves[0], [stick, contact] = [data.curves[1].angle, data.curves[1].lines[0].values];
    const words = [`${time[row].toFixed(2)} s`, `frame ${data.frame[row]}`, stateOf[row].replace("_", " ")];
    words.push(angle[row] === null ? "no angle" : showAngle(angle[row], low[row], high[row]));
    words.push(`${stick[row]} of ${contact[row]} markers stick`);
    const alert = wordAt(data.alerts, row), scene = shownScene();
    if (!["", "none", "unknown"].includes(alert)) words.push(`alert: ${alert}`);
    if (scene && scene.row !== row) words.push(`markers of frame ${data.frame[scene.row]}`);
    document.getElementById("now").textContent = words.join(" · ");
    document.getElementById("reason").textContent = wordAt(data.reasons, row);
  }

  function showAngle(angle, low, high) {
    const known = low !== null && high !== null, half = known ? Math.max(angle - low, high - angle) : 0;
    const digits = half ? Math.min(Math.max(Math.ceil(-Math.log10(half) - 1e-6), 1), 3) : 1;
    const show = (value) => `${value > 0 ? "+" : ""}${value.toFixed(digits).replace("-", "−")}°`;
    if (!known) return show(angle);
    if (half > 1.5 * Math.min(angle - low, high - angle) + 10 ** -digits) return `${show(angle)} (${show(low)} to ${show(high)})`;
    return `${show(angle)} ± ${half.toFixed(digits)}°`;
  }

  function go(to) {
    row = Math.min(Math.max(to, 0), last);
    slider.value = row;
    describe();
    slider.setAttribute("aria-valuetext", document.getElementById("now").textContent);
    draw();
  }

  function rowAt(seconds) {
    const before = lastIndex(time, (one) => one <= seconds), after = Math.min(before + 1, last);
    return seconds - time[before] > time[after] - seconds ? after : before;
  }

  // Starts or stops playing, at the recording's own pace.
  function play(begins) {
    cancelAnimationFrame(frame);
    frame = null;
    button.textContent = begins ? "Pause" : "Play";
    if (!begins) return;
    if (row === last) go(0);
    const start = time[row];
    let began = null;
    const tick = (now) => {
      began ??= now;
      const next = rowAt(start + (now - began) / 1000);
      if (next !== row) go(next);
      if (row === last) play(false);
      else frame = requestAnimationFrame(tick);
    };
    frame = requestAnimationFrame(tick);
  }

  button.onclick = () => play(frame === null);
  slider.max = last;
  slider.oninput = () => { play(false); go(Number(slider.value)); };
  document.onkeydown = (event) => {
    const step = {ArrowLeft: -1, ArrowRight: 1}[event.key] * (event.shiftKey ? 10 : 1);
    if (!step || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    play(false);
    go(row + step);
  };
  player.hidden = false;
  player.querySelector(".field").hidden = !scenes.length;
  new ResizeObserver(draw).observe(player);
  go(0);
})();
