// A result (metric-tree/scale/1) or measured objects (metric-tree/objects/1), read in the browser.
"use strict";
(function () {
  const SVG = "http://www.w3.org/2000/svg";
  const message = document.getElementById("message"), drop = document.getElementById("drop");
  const bySlug = MT_SIZES, byName = {};
  for (const [slug, row] of Object.entries(bySlug)) {
    const name = row[0].toLowerCase();
    if (!byName[name] || bySlug[byName[name]][2] < row[2]) byName[name] = slug;
  }
  let shown = null;

  function slugOf(object) {
    if (object.node) return object.node.replace(/\//g, "~").replace(/:/g, "-");
    const name = String(object.category).toLowerCase().replace(/_/g, " ");
    if (byName[name]) return byName[name];
    const hit = window.metricTree.search && window.metricTree.search(name).find((one) => one.slug);
    return hit ? hit.slug : null;
  }
  // What an object says of the scale: its category's 5, 50 and 95 % quantile over its own size, in metres per unit,
  // over the dimensions used; the narrowest of them is drawn.
  function saying(object) {
    const sizes = (bySlug[slugOf(object)] || [])[3];
    if (!sizes) return null;
    const own = object.dimensions || {};
    const used = object.used && object.used.length ? object.used : Object.keys(own).filter((dim) => !(object.truncated || []).includes(dim));
    const rows = used.filter((dim) => sizes[dim] && own[dim] > 0).map((dim) => sizes[dim].map((mm) => mm / 1000 / own[dim]));
    rows.sort((a, b) => a[2] / a[0] - b[2] / b[0]);
    return rows[0] || null;
  }
  function element(name, attributes, text) {
    const one = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
    if (text !== undefined) one.textContent = text;
    return one;
  }
  function scaleText(value) { return Number(value.toPrecision(3)).toString(); }
  function picture(result) {
    const place = document.getElementById("posterior");
    const rows = result.objects.map((object) => ({ object, q: saying(object) })).filter((row) => row.q);
    if (!rows.length) { place.replaceChildren(); return; }
    const values = rows.flatMap((row) => row.q).concat(result.interval ? [result.interval.low, result.interval.high] : []);
    const low = Math.min(...values) * 0.92, high = Math.max(...values) * 1.08;
    const width = Math.max(320, Math.min(place.clientWidth || 900, 1000)), line = 30, height = rows.length * line + 34;
    const at = (s) => 8 + (Math.log(s / low) / Math.log(high / low)) * (width - 16);
    const svg = element("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": "What each object says of the scale; the table below has the same" });
    if (result.interval) {
      svg.append(element("rect", { x: at(result.interval.low), y: 0, width: Math.max(1, at(result.interval.high) - at(result.interval.low)), height: height - 22, fill: "var(--band)" }));
      svg.append(element("path", { d: `M${at(result.scale)} 0V${height - 22}`, stroke: "currentColor", "stroke-width": 2 }));
    }
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
      for (const step of [1, 2, 5]) {
        const s = step * 10 ** power;
        if (s < low || s > high) continue;
        svg.append(element("path", { d: `M${at(s)} 0V${height - 22}`, class: "grid" }));
        svg.append(element("text", { x: at(s), y: height - 6, "text-anchor": "middle" }, scaleText(s)));
      }
    rows.forEach(({ object, q }, k) => {
      const y = k * line + 20, colour = object.verdict === "outlier" ? "var(--judged)" : object.verdict === "skipped" ? "var(--reference)" : "var(--object)";
      svg.append(element("rect", { x: at(q[0]), y, width: Math.max(2, at(q[2]) - at(q[0])), height: 6, rx: 3, fill: colour, "fill-opacity": Math.max(0.25, object.weight ?? 1) }));
      svg.append(element("circle", { cx: at(object.scale || q[1]), cy: y + 3, r: 5, fill: colour }));
      svg.append(element("text", { x: Math.max(4, Math.min(at(q[0]), width - 9 * String(object.id).length - 4)), y: y - 5 }, object.id));
    });
    place.replaceChildren(svg);
  }
  function show(result, name) {
    shown = result;
    const computed = result.schema === "metric-tree/scale/1";
    if (!computed && result.schema !== "metric-tree/objects/1") {
      message.textContent = `${name}: schema: expected metric-tree/scale/1 or metric-tree/objects/1, found ${result.schema || "none"}.`;
      return;
    }
    if (!Array.isArray(result.objects)) { message.textContent = `${name}: objects: expected a list.`; return; }
    message.textContent = "";
    document.getElementById("result").hidden = false;
    const head = document.getElementById("headline");
    if (!computed) head.textContent = `${result.objects.length} measured objects: what each says alone.`;
    else if (result.scale) head.textContent = `${scaleText(result.scale)} metres per unit; ${Math.round(100 * result.interval.level)} % between ${scaleText(result.interval.low)} and ${scaleText(result.interval.high)} (${result.status}).`;
    else head.textContent = "The scale is unresolved" + (result.failure ? `: ${result.failure.message}` : ".");
    picture(result);
    document.querySelector("#objects tbody").replaceChildren(...result.objects.map((object) => {
      const row = document.createElement("tr");
      const id = document.createElement("th");
      id.scope = "row";
      id.textContent = object.id ?? "";
      row.append(id);
      const slug = slugOf(object), category = row.insertCell();
      if (slug && bySlug[slug]) {
        const link = document.createElement("a");
        link.href = `nodes/${slug}.html`;
        link.textContent = object.category;
        category.append(link);
      } else category.textContent = object.category;
      const q = saying(object);
      row.insertCell().textContent = (object.used || Object.keys(object.dimensions || {})).join(", ");
      row.insertCell().textContent = object.scale ? scaleText(object.scale) : q ? `${scaleText(q[0])} to ${scaleText(q[2])}` : "–";
      row.insertCell().textContent = object.weight === undefined ? "" : object.weight.toFixed(2);
      row.insertCell().textContent = object.verdict || "";
      row.insertCell().textContent = object.reason || (q ? "" : "no size is known of it");
      return row;
    }));
    list("help", "help-rows", (result.would_help || []).map((one) => `${one.what}${one.object ? ` (${one.object})` : ""}: narrows the interval by ${Math.round(100 * one.narrows_by)} %`));
    list("warned", "warnings", result.warnings || []);
    offer(!computed);
  }
  function list(section, place, texts) {
    document.getElementById(section).hidden = !texts.length;
    document.getElementById(place).replaceChildren(...texts.map((text) => { const item = document.createElement("li"); item.textContent = text; return item; }));
  }
  // Where the page comes from `metric-tree serve`, it can compute.
  const compute = document.getElementById("compute");
  function offer(wanted) {
    compute.hidden = !(wanted && location.protocol !== "file:");
  }
  compute.addEventListener("click", async () => {
    compute.disabled = true;
    try {
      const answer = await fetch("v1/scale", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(shown) });
      const record = await answer.json().catch(() => null);
      if (answer.ok && record) show(record, "the server's answer");
      else message.textContent = (record && record.detail) || "This site is made of files and cannot compute; use metric-tree serve.";
    } catch (error) { message.textContent = "The server does not answer."; }
    compute.disabled = false;
  });
  async function read(file) {
    const scene = /\.glb$/i.test(file.name);
    message.textContent = "";
    try { if (scene) window.metricTree.view3d.show(await file.arrayBuffer()); else show(JSON.parse(await file.text()), file.name); }
    catch (error) { message.textContent = `${file.name}: ${scene ? "" : "expected JSON; "}${error.message}`; }
  }
  document.getElementById("file").addEventListener("change", (event) => event.target.files[0] && read(event.target.files[0]));
  document.getElementById("example").addEventListener("click", () => show(JSON.parse(document.getElementById("example-data").textContent), "the example"));
  for (const kind of ["dragover", "dragleave", "drop"]) drop.addEventListener(kind, (event) => {
    event.preventDefault();
    drop.classList.toggle("over", kind === "dragover");
    if (kind === "drop" && event.dataTransfer.files[0]) read(event.dataTransfer.files[0]);
  });
  addEventListener("resize", () => shown && picture(shown));
})();
