"use strict";
// Sorts a table by the header that is pressed, or that the address names: #sort=TABLE,COLUMN[,descending], COLUMN from 1.
(() => {
  const status = document.getElementById("status");
  const keyOf = (cell) => {
    const key = cell.dataset.key;
    if (key === undefined) return cell.textContent.trim().toLowerCase();
    return key === "" ? null : Number(key);
  };
  const order = (a, b) => (typeof a === "string" || typeof b === "string" ? String(a).localeCompare(String(b)) : a - b);

  function sort(table, column, descending) {
    const heads = [...table.tHead.rows[0].cells];
    if (!heads[column]) return;
    const rows = [...table.tBodies[0].rows].map((row) => ({ row, key: keyOf(row.cells[column]) }));
    rows.sort((a, b) => {
      if (a.key === null || b.key === null) return (a.key === null) - (b.key === null); // what is missing stays last
      return descending ? order(b.key, a.key) : order(a.key, b.key);
    });
    table.tBodies[0].append(...rows.map((entry) => entry.row));
    heads.forEach((head, k) => {
      if (k === column) head.setAttribute("aria-sort", descending ? "descending" : "ascending");
      else head.removeAttribute("aria-sort");
    });
    const way = descending ? "descending" : "ascending";
    status.textContent = `${table.caption.textContent}: sorted by ${heads[column].textContent}, ${way}`;
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      button.addEventListener("click", () => sort(table, column, head.getAttribute("aria-sort") === "ascending"));
      head.append(button);
    });
  }

  const theme = document.getElementById("theme");
  const dark = () =>
    (document.documentElement.dataset.theme ||
      (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
  const paint = (name) => {
    if (name) document.documentElement.dataset.theme = name;
    theme.textContent = dark() ? "Light page" : "Dark page";
  };
  theme.hidden = false;
  theme.addEventListener("click", () => paint(dark() ? "light" : "dark"));

  function follow() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    paint(["light", "dark"].includes(wanted.get("theme")) ? wanted.get("theme") : "");
    const [name, column, way] = (wanted.get("sort") || "").split(",");
    const table = name && document.getElementById(name);
    if (table && table.matches("table.sortable")) sort(table, Number(column) - 1, way === "descending");
  }
  window.addEventListener("hashchange", follow);
  follow();
})();
