const fields = [...document.querySelectorAll("tr[data-node]")]
const quoted = text => '"' + text.replaceAll('"', '""') + '"'
document.getElementById("save").addEventListener("click", () => {
  const name = document.getElementById("reviewer").value.trim()
  if (!name || name.startsWith("program")) { alert("Your name comes first."); return }
  const day = new Date().toISOString().slice(0, 10)
  const lines = fields.filter(row => row.querySelector("select").value).map(row => {
    const cells = [...row.querySelectorAll("input[type=number]")].map(cell => cell.value)
    const why = row.querySelector("input[type=text]").value || row.querySelector("select").value
    return [row.dataset.node, ...cells, quoted(why), quoted(name), day].join(",")
  })
  const link = document.createElement("a")
  link.href = URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }))
  link.download = "ranges-" + day + ".csv"
  link.click()
})
