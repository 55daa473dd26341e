// Units, sortable tables, the slider of years, the search: everything works without them but these.
"use strict";
(function () {
  const root = document.documentElement.dataset.root;
  const UNITS = { mm: 1, cm: 10, m: 1000, in: 25.4 };
  const NAMES = { in: "in" };

  // Lengths in the unit that the reader chose.
  function number(value) {
    if (value >= 100) return Math.round(value).toLocaleString("en");
    return String(Number(value.toPrecision(3)));
  }
  // With `typical`, a length of the table, all cells have one unit and three digits of that length.
  function lengthText(mm, unit, typical) {
    const usual = typical || mm;
    if (!unit || unit === "auto") unit = usual >= 2e6 ? "km" : usual >= 1000 ? "m" : usual >= 20 ? "cm" : "mm";
    const factor = unit === "km" ? 1e6 : UNITS[unit];
    if (typical) {
      const digits = Math.min(Math.max(2 - Math.floor(Math.log10(typical / factor)), 0), 4);
      return (mm / factor).toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits }) + " " + (NAMES[unit] || unit);
    }
    return number(mm / factor) + " " + (NAMES[unit] || unit);
  }
  function chosenUnit() { return document.getElementById("units").value; }
  function showUnits(within) {
    for (const one of within.querySelectorAll("data")) one.textContent = lengthText(Number(one.value), chosenUnit(), Number(one.closest("table")?.dataset.typical));
  }
  function sizeElement(mm) {
    const one = document.createElement("data");
    one.value = String(mm);
    one.textContent = lengthText(mm, chosenUnit());
    return one;
  }
  window.metricTree = { root, lengthText, chosenUnit, showUnits, sizeElement };
  const select = document.getElementById("units");
  try { select.value = localStorage.getItem("metric-tree-units") || "auto"; } catch (error) { /* no storage here */ }
  if (select.value !== "auto") showUnits(document);
  select.addEventListener("change", () => {
    try { localStorage.setItem("metric-tree-units", select.value); } catch (error) { /* no storage here */ }
    showUnits(document);
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
  for (const table of document.querySelectorAll("table.sortable")) {
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
    const rows = csv(await (await fetch(more.dataset.href)).text());
    body.replaceChildren(...rows.map(itemRow));
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
    if (!sizes.some(Boolean)) sizes = item.extents_mm.split(" ").map(Number);
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
  let asked = false;
  function load() {
    if (asked) return;
    asked = true;
    for (const name of ["names.js", "search.js"]) {
      const script = document.createElement("script");
      script.src = root + "assets/" + name;
      script.async = false;
      document.head.append(script);
    }
  }
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
