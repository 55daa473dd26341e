for (const box of document.querySelectorAll("input[type=search]")) {
  const rows = [...document.getElementById(box.dataset.table).querySelectorAll("tr")].slice(1)
  const count = document.getElementById(box.dataset.table + "-count")
  box.addEventListener("input", () => {
    const words = box.value.toLowerCase().split(/\s+/).filter(Boolean)
    let shown = 0
    for (const row of rows) {
      const text = row.dataset.words
      row.hidden = !words.every(word => text.includes(word))
      shown += !row.hidden
    }
    count.textContent = shown + " of " + rows.length
  })
}
