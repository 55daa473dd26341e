// Up to six categories on one logarithmic axis, from assets/sizes.js.
"use strict";
(function () {
  const MOST = 6, SVG = "http://www.w3.org/2000/svg";
  const form = document.getElementById("add"), input = document.getElementById("add-name");
  const dimension = document.getElementById("dimension"), message = document.getElementById("message");
  const asked = new URLSearchParams(location.search);
  let chosen = (asked.get("nodes") || "").split(",").filter((slug) => MT_SIZES[slug]).slice(0, MOST);
  if (asked.get("dim")) dimension.value = asked.get("dim");
  else if (chosen.length) { const dims = Object.keys(MT_SIZES[chosen[0]][3]); dimension.value = dims.includes("height") ? "height" : dims[0]; }

  function element(name, attributes, text) {
    const one = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    if (text !== undefined) one.textContent = text;
    return one;
  }
  function ticks(low, high) {
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
      for (const step of [1, 2, 5]) { const mm = step * 10 ** power; if (mm >= low && mm <= high) found.push(mm); }
    return found.length > 8 ? found.filter((mm) => Number.isInteger(Math.round(Math.log10(mm) * 1e6) / 1e6)) : found;
  }
  function chart(rows) {
    const place = document.getElementById("chart");
    if (!rows.length) { place.replaceChildren(); return; }
    const width = Math.max(320, Math.min(place.clientWidth, 1000)), line = 46, height = rows.length * line + 30;
    const low = Math.min(...rows.map((row) => row.q[0])) * 0.9, high = Math.max(...rows.map((row) => row.q[4])) * 1.1;
    const at = (mm) => 8 + (Math.log(mm / low) / Math.log(high / low)) * (width - 16);
    const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "Sizes of " + rows.map((row) => row.name).join(", ") });
    const unit = window.metricTree.chosenUnit();
    for (const mm of ticks(low, high)) {
      svg.append(element("path", { d: `M${at(mm)} 4V${height - 22}`, class: "grid" }));
      svg.append(element("text", { x: at(mm), y: height - 6, "text-anchor": "middle" }, window.metricTree.lengthText(mm, unit)));
    }
    rows.forEach((row, k) => {
      const y = k * line + 30;
      svg.append(element("rect", { x: at(row.q[0]), y, width: Math.max(2, at(row.q[4]) - at(row.q[0])), height: 10, rx: 4, class: "tier-" + row.tier, "fill-opacity": 0.4 }));
      svg.append(element("rect", { x: at(row.q[1]), y, width: Math.max(2, at(row.q[3]) - at(row.q[1])), height: 10, rx: 2, class: "tier-" + row.tier }));
      svg.append(element("path", { d: `M${at(row.q[2])} ${y - 4}v18`, stroke: "currentColor", "stroke-width": 2.5 }));
      const x = Math.min(at(row.q[0]), width - 8 * row.name.length - 10);
      svg.append(element("text", { x: Math.max(4, x), y: y - 8 }, row.name));
    });
    place.replaceChildren(svg);
  }
  function show() {
    const dim = dimension.value;
    const rows = [], lacking = [];
    for (const slug of chosen) {
      const [name, tier, , sizes] = MT_SIZES[slug];
      if (sizes[dim]) rows.push({ slug, name, tier, q: sizes[dim] });
      else lacking.push(`${name} (has ${Object.keys(sizes).join(", ")})`);
    }
    chart(rows);
    const table = document.getElementById("compared");
    table.hidden = !chosen.length;
    table.tBodies[0].replaceChildren(...chosen.map((slug) => tableRow(slug, dim)));
    message.textContent = lacking.length ? `No ${dim} is known of ${lacking.join("; ")}.` : "";
    const query = new URLSearchParams();
    if (chosen.length) { query.set("nodes", chosen.join(",")); query.set("dim", dim); }
    if (location.search.slice(1) !== query.toString()) history.replaceState(null, "", location.pathname + (chosen.length ? "?" + query.toString().replace(/%2C/g, ",") : ""));
  }
  function tableRow(slug, dim) {
    const [name, tier, , sizes] = MT_SIZES[slug];
    const row = document.createElement("tr");
    const head = document.createElement("th");
    head.scope = "row";
    const link = document.createElement("a");
    link.href = `nodes/${slug}.html`;
    link.textContent = name;
    head.append(link);
    row.append(head);
    const badge = document.createElement("span");
    badge.className = "tier tier-" + tier;
    badge.textContent = tier;
    row.insertCell().append(badge);
    row.insertCell().textContent = dim;
    for (const k of [0, 2, 4]) { const cell = row.insertCell(); if (sizes[dim]) cell.append(window.metricTree.sizeElement(sizes[dim][k])); else cell.textContent = "–"; }
    const remove = document.createElement("button");
    remove.type = "button";
    remove.textContent = "remove";
    remove.setAttribute("aria-label", "remove " + name);
    remove.addEventListener("click", () => { chosen = chosen.filter((one) => one !== slug); show(); });
    row.insertCell().append(remove);
    return row;
  }
  function slugOf(text) {
    const form = text.trim().toLowerCase();
    if (MT_SIZES[form]) return form;
    const named = Object.entries(MT_SIZES).filter(([, row]) => row[0].toLowerCase() === form).sort((a, b) => b[1][2] - a[1][2]);
    if (named.length) return named[0][0];
    const hits = window.metricTree.search ? window.metricTree.search(text).filter((hit) => hit.slug) : [];
    return hits.length ? hits[0].slug : null;
  }
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    await names();
    const slug = slugOf(input.value);
    if (!slug) { message.textContent = `No category is called "${input.value}".`; return; }
    if (chosen.length >= MOST) { message.textContent = `At most ${MOST} categories; remove one first.`; return; }
    if (!chosen.includes(slug)) chosen.push(slug);
    if (!MT_SIZES[slug][3][dimension.value] && chosen.length === 1) dimension.value = Object.keys(MT_SIZES[slug][3])[0];
    input.value = "";
    show();
  });
  // The names that the resolver knows, for words that are no category's own name.
  function names() {
    if (window.metricTree.search) return Promise.resolve();
    document.getElementById("search").dispatchEvent(new Event("input"));
    return new Promise((done) => {
      const until = Date.now() + 3000;
      const wait = () => (window.metricTree.search || Date.now() > until ? done() : setTimeout(wait, 20));
      wait();
    });
  }
  dimension.addEventListener("change", show);
  document.addEventListener("unitschange", show);
  addEventListener("resize", show);
  show();
})();
