// Units, sortable tables, the slider of years, the search: everything works without them but these.
"use strict";
(function () {
  const root = document.documentElement.dataset.root;
  const UNITS = { km: 1e6, m: 1000, cm: 10, mm: 1, in: 25.4, ft: 304.8 };

  // Halves such as 7.635, whose binary form is below, are rounded up, as in `explorer.charts.axis`.
  const HALF_UP = 1 + 1e-12;
  // Lengths in the unit that the reader chose.
  function number(exact) {
    const value = exact * HALF_UP;
    if (value >= 100) return Math.round(value).toLocaleString("en");
    return String(Number(value.toPrecision(3)));
  }
  function usualUnit(mm) { return mm >= 2e6 ? "km" : mm >= 1000 ? "m" : mm >= 20 ? "cm" : "mm"; }
  // Feet and inches: 5′ 7″.
  function feetText(mm, digits) {
    const inches = Number((mm / UNITS.in).toFixed(digits)), feet = Math.floor(inches / 12);
    const rest = (inches - 12 * feet).toFixed(digits) + "″";
    return feet ? `${feet.toLocaleString("en")}′ ${rest}` : rest;
  }
  // With `typical`, a length of the table, all cells have one unit and three digits of that length.
  function lengthText(mm, unit, typical) {
    if (!unit || unit === "auto") unit = usualUnit(typical || mm);
    const value = (mm / UNITS[unit]) * HALF_UP;
    if (unit === "ft") return feetText(mm, (typical || mm) >= 1000 ? 0 : (typical || mm) >= 100 ? 1 : 2);
    if (!typical) return number(value) + " " + unit;
    const digits = Math.min(Math.max(2 - Math.floor(Math.log10(typical / UNITS[unit])), 0), 4);
    return value.toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }) + " " + unit;
  }
  function chosenUnit() { return document.getElementById("units").value; }
  function sizeElement(mm) {
    const one = document.createElement("data");
    one.value = String(mm);
    one.dataset.drawn = "";
    one.textContent = lengthText(mm, chosenUnit());
    return one;
  }
  // Sentences, captions and labels of drawings: their lengths are texts such as `8 to 12 cm`.
  const LENGTHS = /(\d[\d,]*(?:\.\d+)?(?:(?: to | × )\d[\d,]*(?:\.\d+)?)*)\s(km|m|cm|mm)(?!\w)/g;
  function converted(text, unit) {
    if (unit === "auto") return text;
    return text.replace(LENGTHS, (_, numbers, own) => {
      const parts = numbers.split(/( to | × )/);
      const texts = parts.map((part, k) => (k % 2 ? part : lengthText(Number(part.replace(/,/g, "")) * UNITS[own], unit)));
      return unit === "ft" ? texts.join("") : texts.map((part, k) => (k < parts.length - 1 ? part.replace(/ \w+$/, "") : part)).join("");
    });
  }
  const originals = new Map(), NAMES = "tbody th, pre, code, data, script, style, select, h1, .crumbs, .credit, [data-drawn]";
  function showUnits(within) {
    const unit = chosenUnit();
    for (const one of within.querySelectorAll("data")) {
      if (!originals.has(one)) originals.set(one, one.textContent);
      const asWritten = unit === "auto" && !("drawn" in one.dataset);
      one.textContent = asWritten ? originals.get(one) : lengthText(Number(one.value), unit, Number(one.closest("table")?.dataset.typical));
    }
    for (const axis of within.querySelectorAll("g.axis")) drawAxis(axis, unit);
    const walk = document.createTreeWalker(within, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
      const node = walk.currentNode;
      if (!originals.has(node) && (node.parentElement.closest(NAMES) || node.data.search(LENGTHS) < 0)) continue;
      if (!originals.has(node)) originals.set(node, node.data);
      node.data = converted(originals.get(node), unit);
    }
    for (const drawing of within.querySelectorAll("svg.drawing[aria-label]")) {
      if (!originals.has(drawing)) originals.set(drawing, drawing.getAttribute("aria-label"));
      drawing.setAttribute("aria-label", converted(originals.get(drawing), unit));
    }
  }
  // An axis of a drawing with round ticks of the unit, as `LogAxis.svg` draws it for metric units.
  function drawAxis(axis, unit) {
    if (!originals.has(axis)) originals.set(axis, axis.innerHTML);
    if (unit !== "in" && unit !== "ft") axis.innerHTML = originals.get(axis);
    const [low, high, start, end, from, to] = axis.dataset.axis.split(" ").map(Number), vertical = axis.classList.contains("vertical");
    if (unit === "in" || unit === "ft") {
      const base = unit === "ft" && high >= 2 * UNITS.ft ? UNITS.ft : UNITS.in, at = (mm) => start + (Math.log(mm / low) / Math.log(high / low)) * (end - start);
      const ticks = [];
      for (const steps of [[1], [2, 5], [1.5, 3, 4, 6, 7, 8, 9]])
        for (let power = Math.floor(Math.log10(low / base)); power <= Math.ceil(Math.log10(high / base)); power++)
          for (const step of steps) {
            const mm = step * 10 ** power * base;
            if (mm >= low && mm <= high && ticks.length < 6 && ticks.every((one) => Math.abs(at(one) - at(mm)) >= 38)) ticks.push(mm);
          }
      axis.innerHTML = `<path class="grid" d="${ticks.map((mm) => (vertical ? `M${from} ${at(mm)}H${to}` : `M${at(mm)} ${from}V${to}`)).join("")}"/>` +
        ticks.map((mm) => (vertical ? `<text class="end" x="${from - 4}" y="${at(mm) + 4}" data-mm="${mm}"></text>` : `<text x="${at(mm)}" y="${from + 12}" data-mm="${mm}"></text>`)).join("");
    }
    for (const tick of axis.querySelectorAll("[data-mm]")) tick.textContent = lengthText(Number(tick.dataset.mm), unit);
  }
  window.metricTree = { root, lengthText, chosenUnit, showUnits, sizeElement, converted };
  const select = document.getElementById("units");
  try { select.value = localStorage.getItem("metric-tree-units") || "auto"; } catch (error) { /* no storage here */ }
  if (!select.value) select.value = "auto";
  if (select.value !== "auto") showUnits(document.getElementById("main"));
  select.addEventListener("change", () => {
    try { localStorage.setItem("metric-tree-units", select.value); } catch (error) { /* no storage here */ }
    showUnits(document.getElementById("main"));
    document.dispatchEvent(new Event("unitschange"));
  });

  // Tables whose columns sort.
  function key(cell) {
    const data = cell.querySelector("data");
    const text = cell.dataset.sort || (data ? data.value : cell.textContent.trim());
    const value = Number(text.replace(/,/g, ""));
    return text === "" ? [2, 0, ""] : Number.isNaN(value) ? [1, 0, text.toLowerCase()] : [0, value, ""];
  }
  function sort(table, column, down) {
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row) => [key(row.cells[column]), row]);
    const sign = down ? -1 : 1;
    rows.sort(([a], [b]) => a[0] - b[0] || sign * (a[1] - b[1] || (a[2] < b[2] ? -1 : a[2] > b[2] ? 1 : 0)));
    body.append(...rows.map(([, row]) => row));
  }
  // On a phone, rows are stacked: each cell has the label of its column.
  function labelCells(table) {
    const labels = [...table.tHead.rows[0].cells].map((cell) => cell.textContent);
    for (const row of table.tBodies[0].rows) for (const cell of row.cells) if (cell.tagName === "TD") cell.dataset.label = labels[cell.cellIndex];
  }
  // A phone shows one part of a page at a time, and long tables in pages.
  const sortable = document.querySelectorAll("table.sortable"), SHOWN_ROWS = Math.max(5, Math.floor(20 / sortable.length)), narrow = matchMedia("(max-width: 560px)").matches;
  if (narrow) {
    const parts = [...document.querySelectorAll("details.part")], named = parts.find((part) => "#" + part.querySelector("h2").id === location.hash);
    for (const part of parts) Object.assign(part, { open: part === (named || parts[0]), name: "part" });
    for (const list of document.querySelectorAll("details.note")) list.open = false;
  }
  function shorten(table) {
    const rows = [...table.tBodies[0].rows], pager = table.parentElement.querySelector(".pager") || document.createElement("button");
    pager.remove();
    if (!narrow || rows.length <= SHOWN_ROWS) return;
    let first = -SHOWN_ROWS;
    pager.className = "pager";
    pager.onclick = () => {
      first = first + SHOWN_ROWS < rows.length ? first + SHOWN_ROWS : 0;
      rows.forEach((row, k) => { row.hidden = k < first || k >= first + SHOWN_ROWS; });
      pager.textContent = `Rows ${first + 1} to ${Math.min(first + SHOWN_ROWS, rows.length)} of ${rows.length}: show the next ones`;
    };
    pager.onclick();
    table.after(pager);
  }
  for (const table of sortable) {
    labelCells(table);
    shorten(table);
    [...table.tHead.rows[0].cells].forEach((cell, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...cell.childNodes);
      cell.append(button);
      button.addEventListener("click", () => {
        const down = cell.getAttribute("aria-sort") === "ascending";
        for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
        cell.setAttribute("aria-sort", down ? "descending" : "ascending");
        sort(table, column, down);
      });
    });
  }

  // All items of a node.
  const more = document.getElementById("all-items");
  if (more && location.protocol !== "file:") more.addEventListener("click", async () => {
    more.disabled = true;
    const body = document.querySelector("#items tbody");
    const all = csv(await (await fetch(more.dataset.href)).text()), real = all.filter((row) => !["judged", "default"].includes(row.kind)), rows = real.length ? real : all;
    body.replaceChildren(...rows.map(itemRow));
    labelCells(body.parentElement);
    shorten(body.parentElement);
    showUnits(body);
    document.getElementById("items-shown").textContent = rows.length.toLocaleString("en");
    more.remove();
  });
  else if (more) more.remove();
  // The rows of a CSV text as objects; numbers stay texts.
  function csv(text) {
    const table = [[]];
    for (const [, quoted, plain, end] of text.matchAll(/(?:"((?:[^"]|"")*)"|([^",\n]*))(,|\n|$)/g)) {
      if (end === "" && !quoted && !plain) break;
      table[table.length - 1].push(quoted === undefined ? plain : quoted.replace(/""/g, '"'));
      if (end === "\n") table.push([]);
    }
    const [head, ...rows] = table;
    return rows.filter((row) => row.length === head.length).map((row) => Object.fromEntries(row.map((cell, k) => [head[k], cell])));
  }
  function itemRow(item) {
    const row = document.createElement("tr");
    const head = document.createElement("th");
    head.scope = "row";
    const title = item.title || item.item_id;
    if (/^https?:/.test(item.url || "")) {
      const link = document.createElement("a");
      link.href = item.url;
      link.textContent = title;
      head.append(link);
    } else head.textContent = title;
    row.append(head);
    let sizes = [item.length_mm, item.width_mm, item.height_mm].map(Number);
    if (!sizes.some(Boolean)) {
      sizes = item.extents_mm.split(" ").map(Number);
      const note = document.createElement("small");
      note.textContent = " longest side first";
      head.append(note);
    }
    for (let k = 0; k < 3; k++) {
      const cell = row.insertCell();
      if (sizes[k]) cell.append(sizeElement(sizes[k]));
    }
    for (const text of [item.kind, item.year || "", item.source]) row.insertCell().textContent = text;
    return row;
  }

  // Sizes by region and year.
  const data = document.getElementById("context-data");
  if (data) {
    const context = JSON.parse(data.textContent);
    const region = document.getElementById("region"), year = document.getElementById("year");
    const show = () => {
      const place = year ? Number(year.value) : 0;
      if (year) {
        document.getElementById("year-shown").textContent = context.years[place];
        year.setAttribute("aria-valuetext", context.years[place]);
      }
      context.table[region.value][place].forEach((sizes, row) => {
        const cells = document.getElementById("context-rows").rows[row].cells;
        sizes.forEach((mm, k) => cells[k + 1].replaceChildren(sizeElement(mm)));
        showUnits(cells[0].parentElement);
      });
    };
    region.addEventListener("change", show);
    if (year) year.addEventListener("input", show);
    show();
  }

  // The outline: arrow keys open, close and move.
  const outline = document.getElementById("outline");
  if (outline) {
    outline.addEventListener("keydown", (event) => {
      const item = event.target.closest("li"), branch = item.querySelector(":scope > details");
      if (event.key === "ArrowRight" && branch) branch.open = true;
      else if (event.key === "ArrowLeft" && branch && branch.open) branch.open = false;
      else if (event.key === "ArrowLeft") item.parentElement.closest("li")?.querySelector("a").focus();
      else if (event.key === "ArrowDown" || event.key === "ArrowUp") {
        const links = [...outline.querySelectorAll("a")].filter((link) => link.offsetParent);
        links[links.indexOf(item.querySelector("a")) + (event.key === "ArrowDown" ? 1 : -1)]?.focus();
      } else return;
      event.preventDefault();
    });
    const named = document.getElementById(location.hash.slice(1));
    if (named) named.querySelector("details").open = true;
    for (let one = named; one; one = one.parentElement) if (one.tagName === "DETAILS") one.open = true;
    if (named) named.scrollIntoView();
  }

  // The search's script and its index are loaded when the box is first used.
  const box = document.getElementById("search"), list = document.createElement("ul");
  for (const [key, value] of Object.entries({ id: "hits", role: "listbox", "aria-label": "Results", hidden: "" })) list.setAttribute(key, value);
  for (const [key, value] of Object.entries({ role: "combobox", "aria-expanded": "false", "aria-controls": "hits", "aria-autocomplete": "list" })) box.setAttribute(key, value);
  box.after(list);
  let loaded = null;
  function load() {
    loaded ||= Promise.all(["names.js", "search.js"].map((name) => new Promise((done) => {
      const script = document.createElement("script");
      script.src = root + "assets/" + name;
      script.async = false;
      script.addEventListener("load", done);
      document.head.append(script);
    })));
    return loaded;
  }
  window.metricTree.loadSearch = load;
  box.addEventListener("focus", load);
  box.addEventListener("input", load);
  document.addEventListener("keydown", (event) => {
    if (event.key === "/" && !/^(INPUT|SELECT|TEXTAREA)$/.test(document.activeElement.tagName)) {
      event.preventDefault();
      box.focus();
    }
  });
  const query = new URLSearchParams(location.search).get("q");
  if (query) { box.value = query; load(); }
})();
