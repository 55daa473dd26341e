// A result in three dimensions, from the glTF file of `estimate-scale --view-glb`: drawn on a canvas, without WebGL.
"use strict";
(function () {
  const canvas = document.getElementById("view3d"), said = document.getElementById("view3d-said"), list = document.getElementById("view3d-boxes");
  const FLOATS = 5126, KINDS = { 0: "points", 1: "lines", 4: "faces" }, LEAST_ZOOM = 0.2, MOST_ZOOM = 12, CLICK_PX = 4;
  let scene = null, turn = -0.6, tilt = 0.5, zoom = 1, chosen = null, asked = 0;

  // The record and the buffer of a file, or an error in words.
  function parts(buffer) {
    const view = new DataView(buffer);
    if (buffer.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67 || view.getUint32(4, true) !== 2) throw new Error("expected a binary glTF 2.0 file");
    let record = null, binary = null;
    for (let at = 12; at + 8 <= buffer.byteLength;) {
      const length = view.getUint32(at, true), kind = view.getUint32(at + 4, true);
      if (at + 8 + length > buffer.byteLength) throw new Error("a chunk is longer than the file");
      if (kind === 0x4e4f534a) record = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, at + 8, length)));
      else if (kind === 0x004e4942) binary = { start: at + 8, length };
      at += 8 + length;
    }
    if (!record || !binary) throw new Error("expected a record and a buffer");
    return [record, binary];
  }
  function read(buffer) {
    const [record, binary] = parts(buffer), shapes = [], boxes = [];
    const extras = (record.asset && record.asset.extras) || {};
    if (extras.headline === undefined) throw new Error("expected a file of estimate-scale --view-glb");
    function numbers(index) {
      const accessor = record.accessors[index], part = record.bufferViews[accessor.bufferView];
      const width = accessor.type === "VEC4" ? 4 : 3, count = accessor.count * width, start = binary.start + (part.byteOffset || 0);
      const bytes = count * (accessor.componentType === FLOATS ? 4 : 1);
      if ((part.byteOffset || 0) + bytes > binary.length) throw new Error("numbers beyond the buffer");
      const own = buffer.slice(start, start + bytes);
      return accessor.componentType === FLOATS ? new Float32Array(own) : new Uint8Array(own);
    }
    for (const node of record.nodes) {
      const box = node.extras ? { said: node.extras, places: [] } : null;
      if (box) boxes.push(box);
      for (const primitive of record.meshes[node.mesh].primitives) {
        const material = record.materials[primitive.material].pbrMetallicRoughness.baseColorFactor;
        const places = numbers(primitive.attributes.POSITION), colours = primitive.attributes.COLOR_0 === undefined ? null : numbers(primitive.attributes.COLOR_0);
        shapes.push({ kind: KINDS[primitive.mode], places, colours, colour: css(material), alpha: material[3], box });
        if (box && primitive.mode === 1) box.places = places;
      }
    }
    return { shapes, boxes, extras, ...bounds(shapes) };
  }
  function css([red, green, blue]) { return "rgb(" + [red, green, blue].map((value) => Math.round(255 * value ** (1 / 2.2))).join(" ") + ")"; }
  // The middle and the size of all but stray points.
  function bounds(shapes) {
    const low = [], high = [];
    for (let k = 0; k < 3; k++) {
      const solid = [], points = [];
      for (const shape of shapes) for (let at = k; at < shape.places.length; at += 3) (shape.kind === "points" ? points : solid).push(shape.places[at]);
      points.sort((a, b) => a - b);
      if (points.length) solid.push(points[Math.floor(points.length * 0.02)], points[Math.floor(points.length * 0.98)]);
      low.push(solid.reduce((a, b) => Math.min(a, b), Infinity));
      high.push(solid.reduce((a, b) => Math.max(a, b), -Infinity));
    }
    return { middle: low.map((value, k) => (value + high[k]) / 2), size: Math.hypot(...low.map((value, k) => high[k] - value)) || 1 };
  }
  // From a place to pixels and depth.
  function lens(width, height) {
    const [cosTurn, sinTurn, cosTilt, sinTilt] = [Math.cos(turn), Math.sin(turn), Math.cos(tilt), Math.sin(tilt)];
    const eye = 1.6 * scene.size, scale = (zoom * 1.8 * Math.min(width, height)) / scene.size;
    return (x, y, z) => {
      x -= scene.middle[0]; y -= scene.middle[1]; z -= scene.middle[2];
      const across = x * cosTurn - z * sinTurn, back = x * sinTurn + z * cosTurn;
      const up = y * cosTilt - back * sinTilt, near = y * sinTilt + back * cosTilt;
      const depth = Math.max(eye - near, 0.02 * eye), factor = (scale * eye) / depth;
      return [width / 2 + across * factor, height / 2 - up * factor, depth];
    };
  }
  function draw() {
    asked = 0;
    if (!scene || !canvas.clientWidth) return;
    const ratio = Math.min(devicePixelRatio || 1, 2), width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const pen = canvas.getContext("2d"), place = lens(width, height);
    pen.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    for (const kind of ["points", "faces", "lines"]) for (const shape of scene.shapes) if (shape.kind === kind) {
      pen.globalAlpha = shape.alpha;
      pen.fillStyle = pen.strokeStyle = shape.box && shape.box === chosen ? style.getPropertyValue("--focus") : shape.colour;
      pen.lineWidth = shape.box ? (shape.box === chosen ? 3.5 : 2) : 1;
      ({ points: dots, lines: strokes, faces })[kind](pen, place, shape);
    }
    pen.globalAlpha = 1;
    pen.fillStyle = style.getPropertyValue("--ink");
    pen.font = "13px system-ui, sans-serif";
    pen.textAlign = "center";
    for (const box of scene.boxes) {
      const [x, y] = place(...middle(box.places));
      if (box === chosen || zoom > 1.5) pen.fillText(`${box.said.category} ${box.said.id}`, x, y);
    }
  }
  function dots(pen, place, { places, colours }) {
    let last = "";
    for (let k = 0; k < places.length / 3; k++) {
      const [x, y] = place(places[3 * k], places[3 * k + 1], places[3 * k + 2]);
      const own = colours ? css([colours[4 * k] / 255, colours[4 * k + 1] / 255, colours[4 * k + 2] / 255]) : last;
      if (own !== last) pen.fillStyle = last = own;
      pen.fillRect(x, y, 1.6, 1.6);
    }
  }
  function strokes(pen, place, { places }) {
    pen.beginPath();
    for (let at = 0; at < places.length; at += 6) {
      pen.moveTo(...place(places[at], places[at + 1], places[at + 2]).slice(0, 2));
      pen.lineTo(...place(places[at + 3], places[at + 4], places[at + 5]).slice(0, 2));
    }
    pen.stroke();
  }
  function faces(pen, place, { places }) {
    for (let at = 0; at < places.length; at += 9) {
      pen.beginPath();
      for (let k = 0; k < 9; k += 3) pen.lineTo(...place(places[at + k], places[at + k + 1], places[at + k + 2]).slice(0, 2));
      pen.fill();
    }
  }
  function middle(places) {
    const sum = [0, 0, 0];
    places.forEach((value, at) => { sum[at % 3] += (value * 3) / places.length; });
    return sum;
  }
  // The box whose outline holds a pixel; of several the one whose outline is least, as small objects stand before large ones.
  function boxAt(x, y) {
    const place = lens(canvas.clientWidth, canvas.clientHeight);
    let best = null;
    for (const box of scene.boxes) {
      const ends = [];
      for (let at = 0; at < box.places.length; at += 3) ends.push(place(box.places[at], box.places[at + 1], box.places[at + 2]));
      const outline = hull(ends);
      if (!holds(outline, x, y)) continue;
      const area = Math.abs(outline.reduce((sum, [a, b], k) => { const [c, d] = outline[(k + 1) % outline.length]; return sum + a * d - b * c; }, 0));
      if (!best || area < best.area) best = { box, area };
    }
    return best && best.box;
  }
  function hull(ends) {
    const sorted = [...ends].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (points) => {
      const kept = [];
      for (const point of points) {
        while (kept.length > 1 && cross(kept[kept.length - 2], kept[kept.length - 1], point) <= 0) kept.pop();
        kept.push(point);
      }
      return kept.slice(0, -1);
    };
    return [...half(sorted), ...half(sorted.reverse())];
  }
  function cross([a, b], [c, d], [e, f]) { return (c - a) * (f - b) - (d - b) * (e - a); }
  function holds(outline, x, y) { return outline.length > 2 && outline.every((point, k) => cross(point, outline[(k + 1) % outline.length], [x, y]) >= 0); }
  function choose(box) {
    chosen = box;
    const one = box && box.said;
    said.textContent = one ? [`${one.category} ${one.id}: ${one.sizes.join(", ")} ${scene.extras.unit}`, `${one.verdict}${one.reason ? ": " + one.reason : ""}`, `weight ${one.weight}`, `category ${one.node || "not known"} (${one.tier || "no size"})`].join("; ") : "Click on a box for what it says. Drag or use the arrow keys to turn, + and - to come nearer.";
    [...list.children].forEach((item, k) => item.firstChild.setAttribute("aria-pressed", String(scene.boxes[k] === box)));
    redraw();
  }
  function redraw() { if (!asked) asked = requestAnimationFrame(draw); }
  // Show the bytes of a file; throws an error in words.
  function show(buffer) {
    scene = read(buffer);
    document.getElementById("scene3d").hidden = false;
    document.getElementById("view3d-head").textContent = scene.extras.headline;
    list.replaceChildren(...scene.boxes.map((box) => {
      const item = document.createElement("li"), button = document.createElement("button");
      button.type = "button";
      button.textContent = `${box.said.category} ${box.said.id}`;
      button.addEventListener("click", () => choose(box));
      item.append(button);
      return item;
    }));
    choose(null);
  }
  const pointers = new Map();
  let start = null;
  canvas.addEventListener("pointerdown", (event) => { pointers.set(event.pointerId, event); start = event; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    if (pointers.size === 1) {
      turn -= (event.clientX - before.clientX) / 180;
      tilt = Math.max(-0.2, Math.min(1.57, tilt + (event.clientY - before.clientY) / 180));
    } else {
      const other = [...pointers.values()].find((one) => one.pointerId !== event.pointerId);
      near(Math.hypot(event.clientX - other.clientX, event.clientY - other.clientY) / Math.max(1, Math.hypot(before.clientX - other.clientX, before.clientY - other.clientY)));
    }
    pointers.set(event.pointerId, event);
    redraw();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => {
    pointers.delete(event.pointerId);
    if (name === "pointerup" && start && Math.hypot(event.clientX - start.clientX, event.clientY - start.clientY) <= CLICK_PX) {
      const frame = canvas.getBoundingClientRect();
      choose(boxAt(event.clientX - frame.left, event.clientY - frame.top));
    }
  });
  function near(factor) { zoom = Math.max(LEAST_ZOOM, Math.min(MOST_ZOOM, zoom * factor)); redraw(); }
  canvas.addEventListener("wheel", (event) => { if (scene && (event.ctrlKey || document.activeElement === canvas)) { event.preventDefault(); near(Math.exp(-event.deltaY / 500)); } }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const keys = { ArrowLeft: () => { turn += 0.1; }, ArrowRight: () => { turn -= 0.1; }, ArrowUp: () => { tilt = Math.min(1.57, tilt + 0.1); }, ArrowDown: () => { tilt = Math.max(-0.2, tilt - 0.1); }, "+": () => near(1.2), "-": () => near(1 / 1.2) };
    if (!keys[event.key]) return;
    keys[event.key]();
    event.preventDefault();
    redraw();
  });
  document.getElementById("view3d-above").addEventListener("click", () => { tilt = 1.57; turn = 0; zoom = 1; redraw(); });
  addEventListener("resize", redraw);
  window.metricTree.view3d = { show, boxAt, choose, boxes: () => (scene ? scene.boxes.map((box) => box.said.id) : []), pixel: (id) => lens(canvas.clientWidth, canvas.clientHeight)(...middle(scene.boxes.find((box) => box.said.id === id).places)) };
})();
