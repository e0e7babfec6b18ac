// Sorts a table by the column whose heading is pressed; numbers as numbers, empty cells last.
"use strict";
for (const table of document.querySelectorAll("table.sortable")) {
  const body = table.tBodies[0];
  const headings = [...table.tHead.rows[0].cells];
  headings.forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...heading.childNodes);
    button.title = heading.title ? `${heading.title}; press to sort` : "sort by this column";
    heading.append(button);
    button.addEventListener("click", () => {
      const up = heading.getAttribute("aria-sort") !== "ascending";
      headings.forEach((one) => one.removeAttribute("aria-sort"));
      heading.setAttribute("aria-sort", up ? "ascending" : "descending");
      const numeric = heading.classList.contains("number");
      const keyed = [...body.rows].map((row) => {
        const text = row.cells[column].textContent.trim();
        return {row, key: numeric ? parseFloat(text.replaceAll(",", "")) : text, empty: text === "" || text === "-"};
      });
      keyed.sort((a, b) => {
        if (a.empty || b.empty) return a.empty - b.empty;
        const order = numeric ? a.key - b.key : a.key.localeCompare(b.key, "en", {numeric: true});
        return up ? order : -order;
      });
      body.append(...keyed.map((one) => one.row));
    });
  });
}
// Closed tables are on paper too; what was closed is closed again.
const opened = [];
addEventListener("beforeprint", () => {
  for (const box of document.querySelectorAll("details:not([open])")) { box.open = true; opened.push(box); }
});
addEventListener("afterprint", () => { for (const box of opened.splice(0)) box.open = false; });
