// Search as you type: the index is made by the tree's resolver; this unfolds and ranks it.
"use strict";
(function () {
  const root = document.documentElement.dataset.root;
  const LIMIT = 12;  // maximum number of categories in a list of results
  function fold(text) {
    const plain = text.toLowerCase().replace(/ß/g, "ss").replace(/ø/g, "o").normalize("NFKD").replace(/[\u0300-\u036f'’‘`´]/g, "").replace(/&/g, " and ");
    return plain.replace(/[^a-z0-9]+/g, " ").trim().split(" ").map((word) => MT_NAMES.spellings[word] || word).join(" ");
  }
  function spelled(slug) { return slug.replace(/^mt-/, "").split(".")[0].replace(/_/g, " "); }
  const names = [], labels = [];
  function addName(name, owners) { names.push({ name, owners, words: name.split(" ") }); }
  const nodes = MT_NAMES.nodes.split("\n").map((line) => {
    const [slug, name, tier, items, parent, sizes, marks] = line.split("\t");
    return { sizes: sizes ? sizes.split(",") : [], marks, slug, name: name || spelled(slug), tier: MT_NAMES.tiers[tier], items: Number(items), parent: parent === "" ? -1 : Number(parent), labels: [] };
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
  function likeness(name, words, text) {
    const extra = Math.min(name.name.length - text.length, 20);
    if (name.name.startsWith(text)) return 80 - extra;
    return words.every((word) => name.words.some((own) => own.startsWith(word))) ? 55 - extra : 0;
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
  const places = new Map(nodes.map((node, place) => [node.slug, place]));
  const sources = MT_NAMES.sources.map(([id, title]) => ({ id, title, form: fold(id + " " + title) }));
  const LEADING = new RegExp(MT_NAMES.leading, "i"), TRAILING = new RegExp(MT_NAMES.trailing, "i"), PUNCTUATION = new RegExp(MT_NAMES.punctuation, "g");
  const heads = new Set(MT_NAMES.heads), modifiers = new Set(MT_NAMES.modifiers), copies = new Set(MT_NAMES.copies), containers = new Set(MT_NAMES.containers);
  // Nodes by name, as `Resolver._of_form`: of the name, of its singulars, and of names that differ in spaces.
  const known = new Map(names.map((one) => [one.name, one.owners])), others = new Map(Object.entries(MT_NAMES.others).map(([name, place]) => [name, [place]])), compact = new Map();
  for (const { name, node } of labels) if (!known.has(name)) known.set(name, [node]);
  for (const name of known.keys()) if (!compact.has(name.replace(/ /g, ""))) compact.set(name.replace(/ /g, ""), name);
  const ENDINGS = [["men", "man"], ["ae", "a"], ["kes", "x"], ["ges", "x"], ["eaux", "eau"], ["aux", "al"], ["ia", "ium"], ["i", "us"], ["i", "o"], ["es", "is"], ["a", "um"]];
  function singulars(word) {
    if (word.length < 3 || word.endsWith("ss")) return [];
    const found = [];
    if (word.endsWith("ies") && word.length > 4) found.push(word.slice(0, -3) + "y");
    if (word.endsWith("ves")) found.push(word.slice(0, -3) + "f", word.slice(0, -3) + "fe");
    if (/(s|x|z|ch|sh|o)es$/.test(word)) found.push(word.slice(0, -2));
    if (/s$/.test(word) && !/(us|is)$/.test(word)) found.push(word.slice(0, -1));
    for (const [end, one] of ENDINGS) if (word.endsWith(end) && word.length > end.length + 1) found.push(word.slice(0, -end.length) + one);
    return found;
  }
  function singularPhrases(phrase) {
    const words = phrase.split(" "), last = words.pop(), [first, rest] = phrase.split(/ of (.*)/);
    const found = [...(MT_NAMES.irregular[last] || []), ...singulars(last)].map((one) => [...words, one].join(" "));
    return rest ? [...found, ...singularPhrases(first).map((one) => one + " of " + rest)] : found;
  }
  function ownersOf(form, table = known) {
    const forms = [form, ...singularPhrases(form)], name = forms.find((one) => table.has(one));
    if (name !== undefined || table !== known) return table.get(name);
    const spaced = forms.map((one) => one.replace(/ /g, "")).find((one) => one.length > 4 && compact.has(one));
    return known.get(compact.get(spaced));
  }
  // Nodes of a name with one wrong letter in an unknown word, as `Resolver._misspelt`.
  function misspelt(form) {
    const words = form.split(" "), near = [];
    words.forEach((word, k) => {
      if (word.length >= 5 && !byWord.has(word)) for (const own of byWord.keys())
        if (own.length >= 4 && slips(word, own, 1) === 1) near.push(known.get([...words.slice(0, k), own, ...words.slice(k + 1)].join(" ")));
    });
    const owners = near.filter(Boolean);
    return owners.length && owners.every((one) => one[0] === owners[0][0]) ? owners[0] : undefined;
  }
  const NUMBER = /(?<![\w/])[#(]?\d+(?:[.,x×]\d+)*[-\s]?(?:inch|inches|in|cm|mm|m|ft|l|ml|oz)?\)?(?![\w/])/g;
  // Nodes of a phrase that the index can explain: a name, content and container, a noun after a count, a name after
  // modifiers, a trusted head noun (`Resolver._match`, without the words of WordNet).
  function resolved(text) {
    const form = fold(text), plain = fold(text.replace(NUMBER, " ")).replace(/^(?:(?:an?|the|his|her|one|two|three|four|five|six|several|many|some|few|multiple) )+/, "") || form;
    const owners = ownersOf(form) || ownersOf(plain) || ownersOf(form, others);
    if (owners || !plain) return owners;
    const held = plain.match(/^(\S+) of (.+)$/);
    if (held && containers.has(held[1])) return ownersOf(held[2] + " " + held[1]) || ownersOf(held[1]);
    const counted = plain.match(/^(?:photo|picture|image|view|pair|set|nest|group|stack|pile|bunch|row|herd|flock|pack|piece|collection|lot|roll|couple|heap|crowd|type|kind|part|cluster|number|slice)s? of (?:(?:an?|the) )?(.+)$/);
    if (counted) return resolved(counted[1]);
    const near = misspelt(form);
    if (near) return taken(near);
    let words = plain.split(" ");
    if (words.slice(0, -1).some((word) => copies.has(word))) return undefined;
    while (words.length > 1 && modifiers.has(words[0])) {
      words = words.slice(1);
      const bare = ownersOf(words.join(" "));
      if (bare) return taken(bare);
    }
    const head = [words[words.length - 1], ...singularPhrases(words[words.length - 1])].find((one) => heads.has(one) || (containers.has(one) && known.has(one)));
    return words.length > 1 && words.length < 5 && head ? taken(known.get(head)) : undefined;
  }
  // Nodes of a text with other words than their names.
  function taken(owners) { return Object.assign([...owners], { isTaken: true }); }

  // Sizes that a name states (`metric_tree.variants`): named variants, and numbers with a unit.
  const STATED = MT_NAMES.stated, PATTERNS = Object.entries(STATED.patterns).map(([kind, pattern]) => [kind, new RegExp(pattern, "i")]);
  const QUANTITY = new RegExp(STATED.patterns.length, "gi"), variants = new Map();
  for (const line of STATED.variants.split("\n")) if (line) {
    const [place, name, sizes, forms] = line.split("\t");
    for (const form of forms.split(",")) variants.set(form, { place: Number(place), stated: name, sizes: sizes.split(",") });
  }
  function variantForm(text) {
    return fold(text.replace(QUANTITY, (_, number, word) => number.replace(",", ".") + " " + STATED.units[word.toLowerCase()][0] + " "));
  }
  function quantityIn(text) {
    if ((text.match(/\d+(?:[.,]\d+)?/g) || []).length !== 1) return null;
    for (const [kind, pattern] of PATTERNS) {
      const match = text.match(pattern);
      const rest = match ? (text.slice(0, match.index) + " " + text.slice(match.index + match[0].length)).trim() : "";
      if (!rest) continue;
      const number = Number(match[1].replace(",", ".")), [, quantity, factor] = kind === "length" ? STATED.units[match[2].toLowerCase()] : ["", kind, 1];
      return { kind: quantity, number: number * factor, words: match[0].trim(), rest };
    }
    return null;
  }
  // Medians by dimension of a prior with the stated ln sizes y (`StatedSize.of`): dimensions are conditioned one by one,
  // without noise for the means, and with it for the weights.
  function conditioned([dims, ...components], y, sd) {
    const d = dims.length, rows = [...dims].flatMap((dim, row) => (dim in y ? [row] : []));
    const parts = components.map((numbers) => {
      const means = [0, sd * sd].map((noise) => {
        const mean = numbers.slice(1, d + 1), cov = mean.map((_, row) => numbers.slice(1 + d * (row + 1), 1 + d * (row + 2)));
        let density = Math.log(numbers[0]);
        for (const row of rows) {
          const variance = cov[row][row] + noise, gap = y[dims[row]] - mean[row], gain = cov.map((line) => line[row] / variance), own = [...cov[row]];
          if (variance < 1e-12) continue;
          density -= (gap * gap) / variance / 2 + Math.log(variance) / 2;
          for (let i = 0; i < d; i++) { mean[i] += gain[i] * gap; for (let j = 0; j < d; j++) cov[i][j] -= gain[i] * own[j]; }
        }
        return { mean, density };
      });
      return { mean: means[0].mean, density: means[1].density };
    });
    const most = Math.max(...parts.map((part) => part.density)), weights = parts.map((part) => Math.exp(part.density - most)), sum = weights.reduce((a, b) => a + b);
    return [...dims].map((dim, row) => dim + Math.exp(parts.reduce((total, part, k) => total + (weights[k] / sum) * part.mean[row], 0)));
  }
  function statedMeaning(text) {
    const form = variantForm(text), alias = [form, ...singularPhrases(form)].find((one) => variants.has(one));
    if (alias) return variants.get(alias);
    const quantity = !/\d/.test(text) || ownersOf(fold(text)) ? null : quantityIn(text), owners = quantity && resolved(quantity.rest);
    for (let place = owners ? owners[0] : -1; place >= 0; place = nodes[place].parent) {
      const rule = STATED.rules.find(([of, kind]) => of === place && kind === quantity.kind);
      if (!rule) continue;
      const [, , factors, exponent, low, high, sd] = rule, prior = STATED.priors[owners[0]];
      if (quantity.number < low || quantity.number > high || !prior) return null;
      const y = {};
      for (const [axis, factor] of Object.entries(factors)) y[prior[0].startsWith("1") ? "lwh".indexOf(axis) + 1 : axis] = Math.log(factor * quantity.number ** exponent);
      return { place: owners[0], stated: quantity.words, sizes: conditioned(prior, y, sd), isTaken: owners.isTaken };
    }
    return null;
  }
  // The text without words about sizes, and its meaning if it states a size, as `explorer.queries.searched_meaning`.
  function searchedMeaning(query) {
    let text = query.replace(PUNCTUATION, " ").replace(/\s+/g, " ").trim();
    for (;;) {
      const meaning = statedMeaning(text);
      if (meaning || known.has(fold(text))) return [text, meaning];
      const shorter = text.replace(LEADING.test(text) ? LEADING : TRAILING, "");
      if (shorter === text) return [text, null];
      text = shorter;
    }
  }
  function search(query) {
    const [text, meaning] = searchedMeaning(query);
    return fold(text) || meaning ? hitsOf(text, meaning) : [];
  }
  function hitsOf(query, meaning) {
    const text = fold(query), words = text.split(" "), lists = MT_NAMES.lists.filter((list) => words.includes(list.split("_")[0]));
    const found = new Map();
    const take = (place, score, why, isMeant, isTaken) => {
      const old = found.get(place), whole = score + Math.min(Math.log10(1 + nodes[place].items) * 3, 10);
      if (!old || old.score < whole) found.set(place, { place, score: whole, why, isMeant, isTaken });
    };
    if (meaning) take(meaning.place, 1000, "", true, meaning.isTaken);
    if (lists.length) {
      const rest = words.filter((word) => !lists.some((list) => list.split("_")[0] === word)).join(" ");
      for (const label of labels) {
        const list = label.lists.find((one) => lists.includes(one));
        if (list && rest && label.name.startsWith(rest)) take(label.node, label.name === rest ? 900 : 105, label.name + " in " + list, label.name === rest);
      }
    }
    const meant = resolved(query);
    if (meant) meant.forEach((place, k) => take(place, 500 - 20 * k, k ? text : "", k === 0, meant.isTaken));
    for (const name of names) {
      const score = likeness(name, words, text);
      if (score) name.owners.forEach((place, k) => take(place, score - 6 * k, name.name));
    }
    if (found.size < 4) for (const [name, score] of misspelled(text)) {
      name.owners.forEach((place, k) => take(place, score - 6 * k, name.name));
    }
    if (!found.size && words.length > 1) (ownersOf(words[words.length - 1]) || []).forEach((place, k) => take(place, -6 * k, ""));
    const hits = [...found.values()].sort((a, b) => b.score - a.score || a.place - b.place).slice(0, LIMIT).map(nodeHit);
    if (meaning && hits[0]) Object.assign(hits[0], { stated: meaning.stated, narrower: "", sizes: axesText({ sizes: meaning.sizes, marks: nodes[meaning.place].marks }) });
    for (const { id, title, form } of sources)
      if (hits.length < LIMIT + 3 && (" " + form).includes(" " + words[0]) && words.every((word) => form.includes(word)))
        hits.push({ href: root + "sources/" + id + ".html", name: title, note: "source", tier: null });
    for (const list of MT_NAMES.lists) if (fold(list).startsWith(text)) hits.push({ href: root + "vocabularies/" + list + ".html", name: list, note: "label list", tier: null });
    return hits;
  }
  const SIDES = { 1: "longest side", 2: "middle side", 3: "shortest side" }, WORDS = { l: "long", w: "wide", h: "high", ...SIDES };
  const FRONT_WORDS = { ...WORDS, l: "wide", w: "deep" }, ROUND_WORDS = { ...WORDS, l: "in diameter", w: "in the smaller diameter" };
  function wordsOf(marks) { return marks.includes("o") ? ROUND_WORDS : marks.includes("f") ? FRONT_WORDS : WORDS; }
  function sizesOf(node) { return node.sizes.map((size) => [size[0], Number(size.slice(1))]); }
  // All axes of a node, as `explorer.everyday_sizes.all_axes_text`.
  function axesText(node) {
    const words = wordsOf(node.marks), { lengthText, chosenUnit } = window.metricTree, unit = chosenUnit();
    const sizes = sizesOf(node).filter(([dim], _, all) => !(dim === "w" && words === ROUND_WORDS && all[0][0] === "l"));
    if (sizes.length && sizes[0][0] === "1") {
      const parts = sizes.map(([, mm]) => lengthText(mm, unit, sizes[0][1]));
      return parts.map((part, k) => (unit === "ft" || k === parts.length - 1 ? part : part.replace(/ \w+$/, ""))).join(" × ") + ", the longest side first";
    }
    const parts = sizes.map(([dim, mm]) => lengthText(mm, unit) + " " + words[dim]);
    return parts.length > 1 ? parts.slice(0, -1).join(", ") + " and " + parts[parts.length - 1] : parts.join("");
  }
  // The narrower categories of a node, as `explorer.responses.narrower_text`.
  function narrowerText(place) {
    const { lengthText, chosenUnit } = window.metricTree, [axis] = sizesOf(nodes[place]).reduce((most, size) => (size[1] > most[1] ? size : most), ["", 0]);
    const known = nodes.filter((node) => node.parent === place && !node.slug.endsWith("~other")).map((node) => [node, (sizesOf(node).find(([dim]) => dim === axis) || [])[1]]).filter(([, mm]) => mm);
    const shown = known.sort(([a], [b]) => b.items - a.items).slice(0, 4), most = Math.max(...shown.map(([, mm]) => mm));
    if (!shown.length || most < 1.5 * Math.min(...shown.map(([, mm]) => mm))) return "";
    return ` Narrower: ${shown.map(([node, mm]) => node.name.split(" (")[0] + " " + lengthText(mm, chosenUnit(), most)).join(", ")} ${wordsOf(nodes[place].marks)[axis]}.`;
  }
  function nodeHit(hit) {
    const node = nodes[hit.place];
    const path = [];
    for (let one = node.parent; one >= 0 && path.length < 2; one = nodes[one].parent) path.unshift(nodes[one].name);
    const said = !hit.why || fold(hit.why) === fold(node.name) ? "" : ' · "' + hit.why + '"';
    const lists = node.labels.flatMap(([, lists]) => lists);
    const shown = lists.length ? " · label of " + [...new Set(lists)].slice(0, 3).join(", ") : "";
    return { href: root + "nodes/" + node.slug + ".html", slug: node.slug, name: node.name, tier: node.tier, exact: Boolean(hit.isMeant), isTaken: hit.isTaken, isMixed: node.marks.includes("x"), narrower: hit.isMeant ? narrowerText(hit.place) : "", sizes: axesText(node), note: path.join(" › ") + said + shown };
  }
  window.metricTree.search = search;
  window.metricTree.searchAnswer = (query) => answerOf(search(query));

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
  // The page of results: an answer for a name, and all hits; of the server if there is one.
  const results = document.getElementById("results");
  function answerOf(hits) {
    const first = hits[0];
    if (!first || !first.exact) return "";
    const start = `${first.isTaken ? "Taken as " : ""}${first.name.split(" (")[0]}${first.stated ? ", " + first.stated : ""}: `;
    if (!first.sizes) return start + "nothing is known of its size.";
    return start + (first.isMixed ? "sizes differ by more than 10 times; choose a narrower category." : `about ${first.sizes} (${first.tier}).${first.narrower}`);
  }
  async function servedAnswer(query) {
    if (location.protocol === "file:") return null;
    try {
      const response = await fetch(root + "v1/search?limit=" + LIMIT + "&q=" + encodeURIComponent(query));
      return response.ok ? await response.json() : null;
    } catch (error) { return null; }
  }
  async function showResults() {
    const query = box.value.trim();
    if (!results || !query) return;
    const local = search(query), served = await servedAnswer(query), byId = new Map(local.map((hit) => [hit.slug, hit]));
    const hits = !served ? local : served.hits.map((hit) => {
      const slug = hit.node.replace(/\//g, "~").replace(/:/g, "-"), place = places.get(slug), sizes = Object.entries(hit.median_mm).map(([dim, mm]) => dim.replace("extent", "")[0] + mm);
      return { ...(byId.get(slug) || nodeHit({ place, why: "" })), sizes: axesText({ sizes, marks: nodes[place].marks }) };
    }).concat(local.filter((hit) => !hit.slug));
    const answer = served ? window.metricTree.converted(served.answer || "", window.metricTree.chosenUnit()) : answerOf(hits);
    document.getElementById("search-answer").textContent = answer || `No category is called "${query}".${hits.length ? " Similar names:" : ""}`;
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
