// Up to six categories to scale on one floor, and whether one fits another, from assets/sizes.js.
"use strict";
(function () {
  const MOST = 6, SVG = "http://www.w3.org/2000/svg", { lengthText, chosenUnit, showUnits, sizeElement } = window.metricTree;
  const SLOT_PX = 82, GAP_PX = 14, TALL_PX = 320, HEAD_PX = 44, FOOT_PX = 34, BAR_PX = 7, NUMBER_PX = 16, STEP_PX = 8, SMALL_MM = 450;
  const WORDS = { height: "high", extent1: "longest side", extent2: "middle side", extent3: "shortest side" };
  const form = document.getElementById("add"), input = document.getElementById("add-name");
  const message = document.getElementById("message"), views = document.querySelector(".scene-views");
  const asked = new URLSearchParams(location.search);
  let chosen = (asked.get("nodes") || "").split(",").filter((slug) => MT_SIZES[slug]).slice(0, MOST);
  let scene = [], scale = 1, slotPx = SLOT_PX, references = null;

  const SIDES = { "": ["long", "wide"], f: ["wide", "deep"], o: ["in diameter", "in the smaller diameter"] };
  function word(slug, dim) {
    return WORDS[dim] || SIDES[MT_SIZES[slug][4]][dim === "length" ? 0 : 1];
  }
  // Median sizes across, up and deep in mm; null where the release has none.
  function category(slug) {
    const [name, , , sizes, , , image] = MT_SIZES[slug];
    const one = { key: slug, name: name.split(" (")[0], image, across: null, up: null, deep: null, words: {} };
    for (const [side, dims] of Object.entries({ across: ["length", "extent1"], up: ["height", "extent2"], deep: ["width", "extent3"] })) {
      const dim = dims.find((known) => sizes[known]);
      if (dim) { one[side] = sizes[dim][1]; one.words[side] = word(slug, dim); }
    }
    if (!one.across && one.deep) { one.across = one.deep; one.deep = null; one.words.across = one.words.deep; }
    return one;
  }
  function reference([name, across, up, outline]) {
    return { key: "reference " + name, name, across, up, deep: null, outline, words: { across: "wide", up: "high" } };
  }
  function largest(one) { return Math.max(one.across || 0, one.up || 0, one.deep || 0); }
  function element(name, attributes, content) {
    const one = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    if (content !== undefined) one.textContent = content;
    return one;
  }
  function sized(one, side) { return one[side] ? lengthText(one[side], chosenUnit()) + " " + one.words[side] : ""; }
  function slot(one, factor) { return Math.max((one.across || 0) * factor, slotPx); }
  // On a narrow screen, objects have numbers in place of names and sizes, which are listed below.
  function isNumbered() { return slotPx < SLOT_PX; }
  function description(one) { return [one.name, sized(one, "across"), sized(one, "deep"), sized(one, "up")].filter(Boolean).join(", "); }

  // Place all objects in a row at the largest scale at which they fit.
  function layout() {
    const kept = Object.fromEntries(scene.map((one) => [one.key, one]));
    const shown = chosen.map(category), most = Math.max(...shown.map(largest));
    if (!references) references = MT_REFERENCES.map(([name]) => name).filter((name) => (name === "hand") === most < SMALL_MM);
    shown.push(...MT_REFERENCES.filter(([name]) => references.includes(name)).map(reference));
    const room = views.clientWidth - 2 * GAP_PX;
    slotPx = SLOT_PX + GAP_PX <= room / shown.length ? SLOT_PX : NUMBER_PX;
    const tall = Math.max(...shown.map((one) => Math.max(one.up || 0, one.deep || 0)), most / 4);
    let low = 0, high = TALL_PX / tall;
    for (let step = 0; step < 40; step++) {
      const factor = (low + high) / 2, width = shown.reduce((sum, one) => sum + slot(one, factor) + GAP_PX, 0);
      if (width <= room + 1) low = factor; else high = factor;
    }
    scale = low;
    let x = GAP_PX;
    for (const one of shown) {
      const half = slot(one, scale) / 2;
      Object.assign(one, kept[one.key] && kept[one.key].moved ? { x: kept[one.key].x, z: kept[one.key].z, moved: true } : { x: x + half, z: 0 });
      x += 2 * half + GAP_PX;
    }
    scene = shown;
    return views.clientWidth;
  }
  // The drawing of an object around (0, 0), the middle of its lower edge.
  function shape(one, view) {
    const side = view === "front" ? "up" : "deep", wide = (one.across || 0) * scale, high = (one[side] || 0) * scale;
    const box = { x: -wide / 2, y: -high, width: wide, height: high };
    const parts = [element("rect", { x: -Math.max(wide, 24) / 2, y: -Math.max(high, 24), width: Math.max(wide, 24), height: Math.max(high, 24), class: "grab" })];
    if (one.outline && view === "front") parts.push(element("path", { d: one.outline, class: "reference", "fill-rule": "evenodd", transform: `translate(${box.x} ${box.y}) scale(${wide / 100} ${high / 100})` }));
    else if (wide && high) {
      parts.push(element("rect", { ...box, class: one.image && view === "front" ? "outline" : "object" }));
      if (one.image && view === "front") parts.push(element("image", { ...box, href: one.image, preserveAspectRatio: "xMidYMax meet", class: "silhouette" }));
    } else if (wide) parts.push(element("rect", { x: box.x, y: -3, width: wide, height: 3, class: one.outline ? "reference" : "object" }));
    else if (high) parts.push(element("rect", { x: -BAR_PX / 2, y: -high, width: BAR_PX, height: high, class: "object" }));
    else parts.push(element("circle", { r: 3, cy: -3, class: "object" }));
    const lines = isNumbered() ? [] : view === "front" ? [sized(one, "across"), sized(one, "up")].filter(Boolean) : [sized(one, "deep") || (one.outline ? "" : "depth not known")];
    lines.forEach((line, k) => parts.push(element("text", { y: -high - 7 - 13 * (lines.length - 1 - k) }, line)));
    return parts;
  }
  function draw() {
    views.hidden = !chosen.length;
    if (!chosen.length) return;
    const width = layout(), deepest = Math.max(...scene.map((one) => one.deep || 0)) * scale;
    const heights = { front: HEAD_PX + Math.max(...scene.map((one) => one.up || 0)) * scale, top: HEAD_PX + 1.25 * deepest };
    for (const view of ["front", "top"]) {
      const svg = document.getElementById(view), floor = heights[view];
      svg.setAttribute("viewBox", `0 0 ${width} ${floor + FOOT_PX}`);
      const groups = scene.map((one) => group(one, view, width, floor, deepest));
      svg.replaceChildren(element("path", { d: `M0 ${floor}H${width}`, class: "floor" }), ...groups);
    }
    document.getElementById("numbered").replaceChildren(...(isNumbered() ? scene : []).map((one) => Object.assign(document.createElement("li"), { textContent: description(one) })));
  }
  function group(one, view, width, floor, deepest) {
    const g = element("g", { class: "movable", tabindex: 0, role: "button", "aria-label": description(one) + "; arrow keys move it" });
    const label = element("text", { y: 15, class: "name" }, isNumbered() ? String(scene.indexOf(one) + 1) : one.name.length > 16 ? one.name.slice(0, 15) + "…" : one.name);
    g.append(...shape(one, view), label);
    const place = () => {
      g.setAttribute("transform", `translate(${one.x} ${view === "top" ? floor - one.z : floor})`);
      label.setAttribute("y", view === "top" ? 15 + one.z : 15);
    };
    const move = (dx, dz) => {
      one.moved = true;
      one.x = Math.min(Math.max(one.x + dx, 0), width);
      one.z = Math.min(Math.max(one.z + dz, 0), 0.25 * deepest + 14);
      for (const other of document.querySelectorAll(".movable")) other.place();
    };
    let from = null;
    g.place = place;
    place();
    g.addEventListener("pointerdown", (event) => { from = event; g.setPointerCapture(event.pointerId); });
    g.addEventListener("pointermove", (event) => {
      if (!from) return;
      move(event.clientX - from.clientX, view === "top" ? from.clientY - event.clientY : 0);
      from = event;
    });
    for (const end of ["pointerup", "pointercancel"]) g.addEventListener(end, () => { from = null; });
    g.addEventListener("keydown", (event) => {
      const steps = { ArrowLeft: [-STEP_PX, 0], ArrowRight: [STEP_PX, 0], ArrowUp: [0, view === "top" ? STEP_PX : 0], ArrowDown: [0, view === "top" ? -STEP_PX : 0] }[event.key];
      if (steps) { move(...steps); event.preventDefault(); }
    });
    return g;
  }
  function show() {
    draw();
    document.getElementById("references").replaceChildren(...(chosen.length ? MT_REFERENCES.map(referenceBox) : []));
    const table = document.getElementById("compared");
    table.hidden = !chosen.length;
    const medians = chosen.flatMap((slug) => Object.values(MT_SIZES[slug][3]).map((q) => q[1])).sort((a, b) => a - b);
    table.dataset.typical = String(medians[medians.length >> 1] || 1);
    table.tBodies[0].replaceChildren(...chosen.map(tableRow));
    showUnits(table);
    const query = chosen.length ? "?nodes=" + chosen.join(",") : "";
    if (location.search !== query) history.replaceState(null, "", location.pathname + query);
  }
  function referenceBox([name]) {
    const label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = references.includes(name);
    box.addEventListener("change", () => { references = box.checked ? [...references, name] : references.filter((one) => one !== name); draw(); });
    label.append(box, " " + name);
    return label;
  }
  function tableRow(slug) {
    const [name, tier, , sizes] = MT_SIZES[slug];
    const row = document.createElement("tr"), head = document.createElement("th"), link = document.createElement("a");
    head.scope = "row";
    link.href = `nodes/${slug}.html`;
    link.textContent = name;
    head.append(link);
    row.append(head);
    const badge = document.createElement("span");
    badge.className = "tier tier-" + tier;
    badge.textContent = tier;
    row.insertCell().append(badge);
    const cell = row.insertCell();
    Object.entries(sizes).forEach(([dim, q]) => {
      const line = document.createElement("div");
      line.append(sizeElement(q[1]), ` ${word(slug, dim)} (`, sizeElement(q[0]), " to ", sizeElement(q[2]), ")");
      cell.append(line);
    });
    const remove = document.createElement("button");
    remove.type = "button";
    remove.textContent = "remove";
    remove.setAttribute("aria-label", "remove " + name);
    remove.addEventListener("click", () => { chosen = chosen.filter((one) => one !== slug); show(); });
    row.insertCell().append(remove);
    return row;
  }
  // The category of a name; the index of the search is loaded for words that are no category's own name.
  async function slugOf(name) {
    const form = name.trim().toLowerCase();
    if (MT_SIZES[form]) return form;
    const named = Object.entries(MT_SIZES).filter(([, row]) => row[0].toLowerCase() === form).sort((a, b) => b[1][2] - a[1][2]);
    if (named.length) return named[0][0];
    await window.metricTree.loadSearch();
    const hit = window.metricTree.search(name).find((one) => one.slug);
    return hit ? hit.slug : null;
  }
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const slug = await slugOf(input.value);
    message.textContent = "";
    if (!slug) message.textContent = `No category is called "${input.value}".`;
    else if (chosen.length >= MOST) message.textContent = `At most ${MOST} categories; remove one first.`;
    else {
      if (!chosen.includes(slug)) chosen.push(slug);
      input.value = "";
      show();
    }
  });

  // Whether an object fits: `explorer.fit` with the same random numbers.
  const PAIRS = 20000, RANKS = [[], [], ["shorter side", "longer side"], ["shortest side", "middle side", "longest side"]];
  function generator(seed) { // mulberry32
    return () => { seed = (seed + 0x6d2b79f5) | 0; let t = Math.imul(seed ^ (seed >>> 15), 1 | seed); t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t; return ((t ^ (t >>> 14)) >>> 0) / 4294967296; };
  }
  // Rows of sizes in mm of random objects of a category; `only` selects dimensions.
  function samples(slug, seed, only) {
    const dims = Object.keys(MT_SIZES[slug][3]), d = dims.length, parts = MT_SIZES[slug][5], random = generator(seed);
    const total = parts.reduce((sum, part) => sum + part[0], 0);
    return Array.from({ length: parts.length ? PAIRS : 1 }, () => {
      let place = random() * total, k = 0;
      while (k < parts.length - 1 && place >= parts[k][0]) place -= parts[k++][0];
      const white = dims.map(() => Math.sqrt(-2 * Math.log(1 - random())) * Math.cos(2 * Math.PI * random()));
      const row = dims.map((_, i) => {
        let sum = parts[k][1 + i];
        for (let j = 0; j <= i; j++) sum += parts[k][1 + d + (i * (i + 1)) / 2 + j] * white[j];
        return Math.exp(sum);
      });
      return row.filter((_, i) => !only || only.includes(dims[i]));
    });
  }
  function statedSides(name) {
    const match = /^\s*(\d+(?:\.\d+)?(?:\s*[x×*]\s*\d+(?:\.\d+)?){1,2})\s*(mm|cm|m|in|ft)?\s*$/i.exec(name);
    const factor = match && { mm: 1, cm: 10, m: 1000, in: 25.4, ft: 304.8 }[(match[2] || "cm").toLowerCase()];
    return match && match[1].split(/[x×*]/).map((side) => Number(side) * factor);
  }
  function fit(names, sides, slugs, wanted) {
    const opening = sides[1] ? sides[1].length === 2 : MT_OPENINGS.includes(slugs[1]);
    const how = wanted || (opening ? "through" : "in");
    const sizes = slugs[1] && MT_SIZES[slugs[1]][3], only = how === "through" && sizes && sizes.length && sizes.height ? ["length", "height"] : null;
    const rows = [0, 1].map((k) => (sides[k] ? [sides[k]] : samples(slugs[k], k + 1, k ? only : null)).map((row) => [...row].sort((a, b) => a - b)));
    const n = how === "through" ? 2 : 3;
    for (const [k, needed] of [[0, 3], [1, n]])
      if (rows[k][0].length < needed) return { how, probability: null, reason: `Not known: ${rows[k][0].length || "none"} of the ${needed} necessary sides of ${names[k]} are known.` };
    const fits = new Array(n).fill(0), count = Math.max(rows[0].length, rows[1].length);
    const at = (k, i) => rows[k][Math.min(i, rows[k].length - 1)];
    const side = (k, i, j) => at(k, i)[k ? at(k, i).length - n + j : j];
    let both = 0;
    for (let i = 0; i < count; i++) {
      let all = true;
      for (let j = 0; j < n; j++) if (side(0, i, j) <= side(1, i, j)) fits[j]++; else all = false;
      if (all) both++;
    }
    const tight = fits.indexOf(Math.min(...fits));
    const median = (k) => lengthText(rows[k].map((_, i) => side(k, i, tight)).sort((a, b) => a - b)[rows[k].length >> 1], chosenUnit());
    const reason = `The ${RANKS[3][tight]} of ${names[0]} is about ${median(0)}, the ${RANKS[n][tight]} of ${names[1]} about ${median(1)}: on this side ${Math.round((100 * fits[tight]) / count)} % of the pairs fit. `;
    return { how, probability: both / count, reason: reason + (how === "through" ? "Straight, with quarter turns; tilting is not considered." : how === "in" && slugs[1] ? `These are outer sides of ${names[1]}; its inside is smaller, so the true probability is lower.` : "") };
  }
  async function answerFit() {
    const texts = ["fit-object", "fit-into"].map((id) => document.getElementById(id).value), sides = texts.map(statedSides);
    const slugs = await Promise.all(texts.map((name, k) => (sides[k] ? null : slugOf(name))));
    const answer = document.getElementById("fit-answer"), reason = document.getElementById("fit-reason"), lost = slugs.findIndex((slug, k) => !slug && !sides[k]);
    reason.textContent = "";
    if (lost >= 0) { answer.textContent = `No category is called "${texts[lost]}".`; return; }
    const names = texts.map((name, k) => (slugs[k] ? MT_SIZES[slugs[k]][0].split(" (")[0] : name.trim()));
    const { how, probability, reason: why } = fit(names, sides, slugs, document.getElementById("fit-how").value);
    answer.textContent = probability === null ? "Not known." : `${names[0]} ${how} ${names[1]}: fits in ${how === "in" && slugs[1] ? "at most " : ""}${Math.round(100 * probability)} % of the pairs.`;
    reason.textContent = why;
  }
  document.getElementById("fit").addEventListener("submit", (event) => { event.preventDefault(); answerFit(); });
  window.metricTree.fit = fit;
  if (asked.get("object")) { document.getElementById("fit-object").value = asked.get("object"); document.getElementById("fit-into").value = asked.get("into") || "door"; answerFit(); }
  document.addEventListener("unitschange", () => { show(); if (document.getElementById("fit-reason").textContent) answerFit(); });
  addEventListener("resize", draw);
  show();
})();
