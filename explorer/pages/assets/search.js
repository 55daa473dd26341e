// Search as you type: the index is made by the tree's resolver; this unfolds and ranks it.
"use strict";
(function () {
  const root = document.documentElement.dataset.root;
  const LIMIT = 12;
  function fold(text) {
    const plain = text.toLowerCase().replace(/ß/g, "ss").replace(/ø/g, "o").normalize("NFKD").replace(/[\u0300-\u036f'’‘`´]/g, "").replace(/&/g, " and ");
    return plain.replace(/[^a-z0-9]+/g, " ").trim().split(" ").map((word) => MT_NAMES.spellings[word] || word).join(" ");
  }
  function spelled(slug) { return slug.replace(/^mt-/, "").split(".")[0].replace(/_/g, " "); }
  const names = [], labels = [];
  function addName(name, owners) { names.push({ name, owners, words: name.split(" ") }); }
  const nodes = MT_NAMES.nodes.split("\n").map((line) => {
    const [slug, name, tier, items, parent, sizes] = line.split("\t");
    return { sizes: sizes ? sizes.split(",") : [], slug, name: name || spelled(slug), tier: MT_NAMES.tiers[tier], items: Number(items), parent: parent === "" ? -1 : Number(parent), labels: [] };
  });
  const shared = new Set();
  for (const line of MT_NAMES.shared.split("\n")) if (line) {
    const [name, owners] = line.split("\t");
    shared.add(name);
    addName(name, owners.split(",").map(Number));
  }
  nodes.forEach((node, place) => { const own = fold(node.name); if (!shared.has(own)) addName(own, [place]); });
  MT_NAMES.aliases.split("\n").forEach((line, place) => { if (line) for (const name of line.split(",")) addName(name, [place]); });
  MT_NAMES.labels.split("\n").forEach((line, place) => {
    if (line) for (const entry of line.split(",")) {
      const [label, letters] = entry.split("@");
      const lists = [...letters].map((letter) => MT_NAMES.lists[letter.charCodeAt(0) - 97]);
      const name = label || fold(nodes[place].name);
      nodes[place].labels.push([name, lists]);
      labels.push({ name, node: place, lists });
    }
  });
  // Letters that differ (insert, delete, change, swap), or more than `most`.
  function slips(a, b, most) {
    if (Math.abs(a.length - b.length) > most) return most + 1;
    let before = [], last = Array.from({ length: b.length + 1 }, (_, k) => k);
    for (let i = 1; i <= a.length; i++) {
      const row = [i];
      let least = i;
      for (let j = 1; j <= b.length; j++) {
        let cost = Math.min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] === b[j - 1] ? 0 : 1));
        if (i > 1 && j > 1 && a[i - 1] === b[j - 2] && a[i - 2] === b[j - 1]) cost = Math.min(cost, before[j - 2] + 1);
        row.push(cost);
        if (cost < least) least = cost;
      }
      if (least > most) return most + 1;
      before = last;
      last = row;
    }
    return last[b.length];
  }
  function likeness(name, words, text, singular) {
    if (name.name === text) return 100;
    if (name.name === singular) return 95;
    if (name.name.startsWith(text)) return 80 - Math.min(name.name.length - text.length, 20);
    if (words.every((word) => name.words.some((own) => own.startsWith(word)))) return 55 - Math.min(name.name.length - text.length, 20);
    return 0;
  }
  // A bit for each letter: a slip changes two at most, so that most names are passed over without a count.
  function letters(text) {
    let bits = 0;
    for (let k = 0; k < text.length; k++) bits |= 1 << (text.charCodeAt(k) % 31);
    return bits;
  }
  function bitCount(bits) { let count = 0; for (; bits; bits &= bits - 1) count++; return count; }
  const masks = new Map(), byWord = new Map();
  for (const name of names) for (const word of new Set([name.name, ...name.words])) {
    if (!byWord.has(word)) { byWord.set(word, []); masks.set(word, letters(word)); }
    byWord.get(word).push(name);
  }
  // Names that are one or two letters off a text, whole or in one word, with their scores.
  function misspelled(text) {
    const most = text.length < 4 ? 0 : text.length < 8 ? 1 : 2, own = letters(text), near = [];
    if (most) for (const [word, owners] of byWord) {
      if (Math.abs(word.length - text.length) > most || bitCount(masks.get(word) ^ own) > 2 * most) continue;
      const count = slips(text, word, most);
      if (count <= most) for (const name of owners) near.push([name, name.name === word ? 50 - 8 * count : 24]);
    }
    return near;
  }
  const sources = MT_NAMES.sources.map(([id, title]) => ({ id, title, form: fold(id + " " + title) }));
  const LEADING = new RegExp(MT_NAMES.leading), TRAILING = new RegExp(MT_NAMES.trailing), known = new Set(names.map((one) => one.name));
  function singularOf(text) { return text.replace(/ies$/, "y").replace(/(ch|sh|s|x)es$/, "$1").replace(/s$/, ""); }
  // The text without words about sizes, as `explorer.queries.searched_text`.
  function searchedText(query) {
    let text = fold(query);
    while (!known.has(text)) {
      const shorter = LEADING.test(text) ? text.replace(LEADING, "") : text.replace(TRAILING, "");
      if (shorter === text) break;
      text = shorter;
    }
    return text;
  }
  // The longest end or beginning of a phrase that is a name: `chairs` of `black wooden chairs`.
  function partOf(words) {
    for (let n = words.length - 1; n > 0; n--)
      for (const part of [words.slice(-n), words.slice(0, n)].map((some) => some.join(" ")))
        if (known.has(part) || known.has(singularOf(part))) return part;
    return "";
  }
  function search(query) {
    const text = searchedText(query);
    if (!text) return [];
    const found = hitsOf(text), words = text.split(" ");
    return found.length || words.length < 2 ? found : hitsOf(partOf(words));
  }
  function hitsOf(text) {
    if (!text) return [];
    const words = text.split(" "), singular = singularOf(text);
    const lists = MT_NAMES.lists.filter((list) => words.includes(list.split("_")[0]));
    const found = new Map();
    const take = (place, score, why) => {
      const old = found.get(place);
      const whole = score + Math.min(Math.log10(1 + nodes[place].items) * 3, 10);
      if (!old || old.score < whole) found.set(place, { place, score: whole, why });
    };
    if (lists.length) {
      const rest = words.filter((word) => !lists.some((list) => list.split("_")[0] === word)).join(" ");
      for (const label of labels) {
        const list = label.lists.find((one) => lists.includes(one));
        if (list && rest && label.name.startsWith(rest)) take(label.node, label.name === rest ? 130 : 105, label.name + " in " + list);
      }
    }
    for (const name of names) {
      const score = likeness(name, words, text, singular);
      if (score) name.owners.forEach((place, k) => take(place, score - 6 * k, name.name));
    }
    for (const label of labels) {
      const own = label.name;
      if (own === text) take(label.node, 60, label.name + " in " + label.lists.slice(0, 3).join(", "));
    }
    if (found.size < 4) for (const [name, score] of misspelled(text)) {
      name.owners.forEach((place, k) => take(place, score - 6 * k, name.name));
    }
    const hits = [...found.values()].sort((a, b) => b.score - a.score || a.place - b.place).slice(0, LIMIT).map(nodeHit);
    for (const { id, title, form } of sources)
      if (hits.length < LIMIT + 3 && (" " + form).includes(" " + words[0]) && words.every((word) => form.includes(word)))
        hits.push({ href: root + "sources/" + id + ".html", name: title, note: "source", tier: null });
    for (const list of MT_NAMES.lists) if (fold(list).startsWith(text)) hits.push({ href: root + "vocabularies/" + list + ".html", name: list, note: "label list", tier: null });
    return hits;
  }
  const WORDS = { l: "long", w: "wide", h: "high" }, FRONT_WORDS = { l: "wide", w: "deep", h: "high" };
  function sizesText(node) {
    const front = node.sizes.includes("f"), { lengthText, chosenUnit } = window.metricTree;
    const parts = node.sizes.filter((size) => size !== "f").map((size) => [size[0], lengthText(Number(size.slice(1)), chosenUnit())]);
    if (parts.length && parts[0][0] === "1") return parts.map(([, text]) => text).join(" × ");
    return parts.map(([dim, text]) => text + " " + (front ? FRONT_WORDS : WORDS)[dim]).join(", ");
  }
  function nodeHit(hit) {
    const node = nodes[hit.place];
    const path = [];
    for (let one = node.parent; one >= 0 && path.length < 2; one = nodes[one].parent) path.unshift(nodes[one].name);
    const said = fold(hit.why || "") === fold(node.name) ? "" : ' · "' + hit.why + '"';
    const lists = node.labels.flatMap(([, lists]) => lists);
    const shown = lists.length ? " · label of " + [...new Set(lists)].slice(0, 3).join(", ") : "";
    return { href: root + "nodes/" + node.slug + ".html", slug: node.slug, name: node.name, tier: node.tier, exact: hit.score >= 90, sizes: sizesText(node), note: path.join(" › ") + said + shown };
  }
  window.metricTree.search = search;

  const box = document.getElementById("search"), list = document.getElementById("hits");
  let chosen = -1;
  function hitLink(hit) {
    const link = document.createElement("a");
    link.href = hit.href;
    link.append(hit.name + " ");
    if (hit.tier) {
      const tier = document.createElement("span");
      tier.className = "tier tier-" + hit.tier;
      tier.textContent = hit.tier;
      link.append(tier);
    }
    for (const text of [hit.sizes, hit.note].filter(Boolean)) {
      const note = document.createElement("small");
      note.textContent = text;
      link.append(note);
    }
    return link;
  }
  // The page of results: an answer for a name, and all hits.
  const results = document.getElementById("results");
  function showResults() {
    if (!results) return;
    const hits = search(box.value), first = hits[0];
    document.getElementById("search-answer").textContent = !box.value ? "" : !first ? `Nothing is called "${box.value}".` : (first.exact || hits.length === 1) && first.sizes ? `${first.name}: about ${first.sizes}.` : "";
    results.replaceChildren(...hits.map((hit) => { const item = document.createElement("li"); item.append(hitLink(hit)); return item; }));
  }
  function show() {
    const hits = search(box.value);
    chosen = -1;
    list.replaceChildren(...hits.map((hit, k) => {
      const item = document.createElement("li"), link = hitLink(hit);
      item.role = "option";
      item.id = "hit-" + k;
      item.setAttribute("aria-selected", "false");
      link.tabIndex = -1;
      item.append(link);
      return item;
    }));
    if (box.value.trim() && !hits.length) {
      const item = document.createElement("li");
      item.role = "option";
      item.setAttribute("aria-selected", "false");
      item.textContent = "nothing like it; the tree page has all categories";
      list.append(item);
    }
    list.hidden = !box.value.trim();
    box.setAttribute("aria-expanded", String(!list.hidden));
    box.removeAttribute("aria-activedescendant");
  }
  function move(step) {
    if (list.hidden) show();
    const items = [...list.children].filter((item) => item.id);
    if (!items.length) return;
    chosen = (chosen + step + items.length + (chosen < 0 && step < 0 ? 1 : 0)) % items.length;
    items.forEach((item, k) => item.setAttribute("aria-selected", String(k === chosen)));
    items[chosen].scrollIntoView({ block: "nearest" });
    box.setAttribute("aria-activedescendant", items[chosen].id);
  }
  box.addEventListener("input", show);
  box.addEventListener("keydown", (event) => {
    if (event.key === "ArrowDown") move(1);
    else if (event.key === "ArrowUp") move(-1);
    else if (event.key === "Escape") { list.hidden = true; box.setAttribute("aria-expanded", "false"); return; }
    else return;
    event.preventDefault();
  });
  // Enter opens the chosen hit, otherwise the page of results.
  box.form.addEventListener("submit", (event) => {
    const link = chosen < 0 ? null : list.children[chosen].querySelector("a");
    if (!link) return;
    event.preventDefault();
    location.href = link.href;
  });
  document.addEventListener("unitschange", showResults);
  document.addEventListener("click", (event) => {
    if (!box.form.contains(event.target)) { list.hidden = true; box.setAttribute("aria-expanded", "false"); }
  });
  if (results) showResults();
  else if (box.value) show();
})();
