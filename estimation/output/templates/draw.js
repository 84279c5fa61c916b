// Draws frames and curves into canvases, for the window of `live` and for reports.
//
// A scene has `size` [width, height], `spots` [x, y, x, y, ...] in its pixels, y down, and `kinds`, a
// letter for each spot: "o" sticks, "x" slips, "." has no contact. A curve has arrays of one length:
// `time` [s], `angle`, `low`, `high` [degrees, null where unknown; the last two may be omitted] and
// `state` (words). It may have a `name`, and further `lines`: `name`, `values`, `colour`, `dash`, and `fit`, whether
// the axis is scaled to them.
// `colours` is `page_colours()` of estimation/output/scene.py.

// A canvas's context in CSS pixels, cleared, and its width and height.
function clearCanvas(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  context.clearRect(0, 0, width, height);
  return [context, width, height];
}

// Draws a scene's markers over its picture, or over a plain background if `picture` is null.
function drawMarkers(canvas, scene, picture, colours) {
  const [context, width, height] = clearCanvas(canvas);
  const scale = Math.min(width / scene.size[0], height / scene.size[1]);
  const left = (width - scale * scene.size[0]) / 2, top = (height - scale * scene.size[1]) / 2;
  context.fillStyle = "#303030";
  context.fillRect(left, top, scale * scene.size[0], scale * scene.size[1]);
  if (picture) {
    const [x, y] = scene.corner || [0, 0];
    context.drawImage(picture, left + scale * x, top + scale * y,
                      scale * picture.width, scale * picture.height);
  }
  const radius = Math.max(2.5, Math.min(6, 0.35 * scale * spacing(scene)));
  for (const halo of [true, false]) {
    context.lineWidth = halo ? 3.5 : 2;
    for (const kind of [".", "o", "x"]) {
      context.strokeStyle = halo ? "rgba(0, 0, 0, 0.55)" : colours.markers[kind];
      context.beginPath();
      for (let i = 0; i < scene.kinds.length; i++) {
        if (scene.kinds[i] !== kind) continue;
        const x = left + scale * (scene.spots[2 * i] + 0.5), y = top + scale * (scene.spots[2 * i + 1] + 0.5);
        if (kind === "x") {
          context.moveTo(x - radius, y - radius); context.lineTo(x + radius, y + radius);
          context.moveTo(x - radius, y + radius); context.lineTo(x + radius, y - radius);
        } else {
          const size = kind === "o" ? radius : 0.4 * radius;
          context.moveTo(x + size, y); context.arc(x, y, size, 0, 2 * Math.PI);
        }
      }
      context.stroke();
    }
  }
}

// Approximate distance between a scene's markers, in its pixels.
function spacing(scene) {
  const count = Math.max(scene.kinds.length, 1);
  return Math.sqrt(scene.size[0] * scene.size[1] / count);
}

// Draws an angle, or any number, with its interval over time, the state as background.
// `options`: `span` [from, to] in seconds, `cursor` a time that is marked, `label` of the axis, `foot`
// false for no times below.
function drawCurve(canvas, curve, colours, options = {}) {
  const [context, width, height] = clearCanvas(canvas);
  const foot = options.foot === false ? 6 : 34, count = curve.time.length;
  const box = {left: 56, top: 8, right: width - 10, bottom: height - foot};
  if (!count || box.right <= box.left || box.bottom <= box.top) return null;
  const [from, to] = options.span || [curve.time[0], curve.time[count - 1]];
  const [low, high] = findRange(curve, from, to);
  const acrossTo = (time) => box.left + (box.right - box.left) * (time - from) / Math.max(to - from, 1e-9);
  const upTo = (value) => box.bottom - (box.bottom - box.top) * (value - low) / (high - low);
  context.save();
  context.beginPath();
  context.rect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  context.clip();
  for (let i = 0; i < count; i++) {
    let next = i + 1;
    while (next < count && curve.state[next] === curve.state[i]) next++;
    const end = next < count ? curve.time[next] : to;
    context.fillStyle = colours.states[curve.state[i]];
    context.fillRect(acrossTo(curve.time[i]), box.top, acrossTo(end) - acrossTo(curve.time[i]) + 0.5, box.bottom - box.top);
    i = next - 1;
  }
  const at = (values, i) => [acrossTo(curve.time[i]), upTo(values[i] ?? curve.angle[i])];
  const stroke = (values) => {
    for (const [start, stop] of findRuns(values)) {
      context.beginPath();
      for (let i = start; i < stop; i++) context.lineTo(...at(values, i));
      if (stop - start === 1) context.arc(...at(values, start), 1, 0, 2 * Math.PI);
      context.stroke();
    }
  };
  for (const line of curve.lines || []) {
    context.strokeStyle = line.colour;
    context.lineWidth = 1.2;
    context.setLineDash(line.dash || []);
    stroke(line.values);
  }
  context.setLineDash([]);
  for (const [start, stop] of curve.low ? findRuns(curve.angle) : []) {
    context.fillStyle = "rgba(8, 48, 107, 0.3)";
    context.beginPath();
    for (let i = start; i < stop; i++) context.lineTo(...at(curve.high, i));
    for (let i = stop - 1; i >= start; i--) context.lineTo(...at(curve.low, i));
    context.fill();
  }
  context.strokeStyle = "#08306b";
  context.lineWidth = 1.8;
  stroke(curve.angle);
  drawNames(context, [...(curve.name ? [{name: curve.name, colour: "#08306b"}] : []), ...(curve.lines || [])],
            box.left + 8, box.top + 4);
  if (options.cursor !== undefined) {
    context.strokeStyle = "#000";
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(acrossTo(options.cursor), box.top); context.lineTo(acrossTo(options.cursor), box.bottom);
    context.stroke();
  }
  context.restore();
  drawAxes(context, box, options.foot === false ? null : [from, to], [low, high], options.label || "angle [°]");
  return {timeAt: (x) => from + (to - from) * (x - box.left) / (box.right - box.left)};
}

// The names of lines in their colours, side by side.
function drawNames(context, lines, left, top) {
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left"; context.textBaseline = "top";
  for (const line of lines) {
    context.strokeStyle = "rgba(255, 255, 255, 0.8)";
    context.lineWidth = 3;
    context.strokeText(line.name, left, top);
    context.fillStyle = line.colour;
    context.fillText(line.name, left, top);
    left += context.measureText(line.name).width + 14;
  }
}

// The range of angles in a span of time; wide intervals may exceed it.
function findRange(curve, from, to) {
  let low = Infinity, high = -Infinity, lowest = Infinity, highest = -Infinity;
  for (let i = 0; i < curve.time.length; i++) {
    if (curve.angle[i] === null || curve.time[i] < from || curve.time[i] > to) continue;
    low = Math.min(low, curve.angle[i]); high = Math.max(high, curve.angle[i]);
    lowest = Math.min(lowest, curve.low?.[i] ?? low); highest = Math.max(highest, curve.high?.[i] ?? high);
  }
  for (const line of curve.lines || []) {
    for (const value of line.fit ? line.values : []) {
      if (value === null) continue;
      low = Math.min(low, value); high = Math.max(high, value);
      lowest = Math.min(lowest, value); highest = Math.max(highest, value);
    }
  }
  if (low > high) return [-1, 1];
  const room = Math.max(1, high - low);
  low = Math.max(lowest, low - room); high = Math.min(highest, high + room);
  const edge = Math.max(0.06 * (high - low), 0.2);
  return [low - edge, high + edge];
}

// First and last (exclusive) index of each stretch without a null.
function findRuns(values) {
  const runs = [];
  for (let i = 0; i < values.length; i++) {
    if (values[i] === null) continue;
    const start = i;
    while (i < values.length && values[i] !== null) i++;
    runs.push([start, i]);
  }
  return runs;
}

function drawAxes(context, box, times, values, label) {
  context.strokeStyle = "#888";
  context.lineWidth = 1;
  context.strokeRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  context.fillStyle = "#222";
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "right"; context.textBaseline = "middle";
  for (const [value, text] of chooseTicks(values, (box.bottom - box.top) / 40)) {
    const y = box.bottom - (box.bottom - box.top) * (value - values[0]) / (values[1] - values[0]);
    context.fillText(text, box.left - 5, y);
    context.fillRect(box.left - 3, y, 3, 1);
  }
  context.textAlign = "center"; context.textBaseline = "top";
  for (const [time, text] of times ? chooseTicks(times, (box.right - box.left) / 80) : []) {
    const x = box.left + (box.right - box.left) * (time - times[0]) / Math.max(times[1] - times[0], 1e-9);
    context.fillText(text, x, box.bottom + 5);
    context.fillRect(x, box.bottom, 1, 3);
  }
  if (times) context.fillText("time since the first frame [s]", (box.left + box.right) / 2, box.bottom + 19);
  context.save();
  context.translate(12, (box.top + box.bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.textBaseline = "middle";
  context.fillText(label, 0, 0);
  context.restore();
}

// About `most` round values within a range, with their texts.
function chooseTicks([low, high], most) {
  if (!(high > low)) return [];
  const rough = (high - low) / Math.max(most, 2), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((one) => one * power >= rough * 0.999);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) {
    ticks.push([k * step, (k * step + 0).toFixed(digits)]);
  }
  return ticks;
}
