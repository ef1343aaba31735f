// Sort a table by a click on a heading, and filter the table of runs.
(() => {
  "use strict";
  const collator = new Intl.Collator("en", { numeric: true, sensitivity: "base" });

  /** Return the sort key of a cell. A numeric column: the number in data-sort, or null if it is empty; other columns: a text. */
  function key(cell, numeric) {
    const given = cell.dataset.sort;
    if (numeric) return given === undefined || given === "" ? null : Number(given);
    return given ?? cell.textContent.trim();
  }

  function sort(table, column, header) {
    const numeric = header.classList.contains("number");
    const best = header.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
    const sign = best === "ascending" ? 1 : -1;
    const body = table.tBodies[0];
    const rows = [...body.rows].map((row, place) => ({ row, place, value: key(row.cells[column], numeric) }));
    rows.sort((a, b) => {
      // Missing values stay at the end in both directions.
      if (a.value === null || b.value === null) return (a.value === null) - (b.value === null) || a.place - b.place;
      const order = numeric ? a.value - b.value : collator.compare(a.value, b.value);
      return sign * order || a.place - b.place;
    });
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    header.setAttribute("aria-sort", best);
    body.append(...rows.map((entry) => entry.row));
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    [...table.tHead.rows[0].cells].forEach((header, column) => {
      header.querySelector("button").addEventListener("click", () => sort(table, column, header));
    });
  }

  const filter = document.getElementById("filter");
  if (filter) {
    const rows = [...document.getElementById("runs-table").tBodies[0].rows];
    const texts = rows.map((row) => row.textContent.toLowerCase());
    filter.closest(".filter").hidden = false;
    filter.addEventListener("input", () => {
      const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0;
      rows.forEach((row, place) => {
        row.hidden = !words.every((word) => texts[place].includes(word));
        shown += !row.hidden;
      });
      document.getElementById("filtered").value = words.length ? `${shown} of ${rows.length}` : "";
    });
    // If a link leads to a run that the filter hides, clear the filter.
    window.addEventListener("hashchange", () => {
      const target = document.getElementById(location.hash.slice(1))?.closest("tr");
      if (target?.hidden) {
        filter.value = "";
        filter.dispatchEvent(new Event("input"));
        target.scrollIntoView();
      }
    });
  }

  // Only a part that scrolls gets keyboard focus, and fades at its side to show that it continues.
  function mark(part) {
    const more = part.scrollWidth - part.clientWidth;
    part.classList.toggle("clipped", more > 1 && part.scrollLeft < more - 1);
    part.classList.toggle("panned", part.scrollLeft > 0);
    if (more > 0 || part.scrollHeight > part.clientHeight) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  }
  const stops = new ResizeObserver((entries) => entries.forEach((entry) => mark(entry.target.closest(".scroll"))));
  for (const part of document.querySelectorAll(".scroll")) {
    stops.observe(part);
    part.addEventListener("scroll", () => mark(part), { passive: true });
    // Observe the contents too: a folded part and an unloaded image get their width later.
    for (const inside of part.children) stops.observe(inside);
  }
})();
