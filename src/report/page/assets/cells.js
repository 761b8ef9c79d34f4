/* Tables: sorting by a heading, filters. */
{
  const value = (row, column) => {
    const cell = row.cells[column];
    if (!cell) return -Infinity;
    return cell.dataset.v === undefined ? cell.textContent.trim() : Number(cell.dataset.v);
  };
  const order = (a, b) => {
    if (typeof a === "number" && typeof b === "number") return a - b;
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return a.localeCompare(b, "en", { numeric: true });
  };

  /* Makes the headings of a table sort its rows. */
  fathom.sortable = (table) => {
    const body = table.tBodies[0];
    [...table.tHead.rows[0].cells].forEach((heading, column) => {
      const button = fathom.element("button", { class: "sort", type: "button" }, heading.textContent);
      heading.replaceChildren(button);
      button.addEventListener("click", () => {
        const down = heading.getAttribute("aria-sort") === "ascending";
        fathom.all("[aria-sort]", table.tHead).forEach((other) => other.removeAttribute("aria-sort"));
        heading.setAttribute("aria-sort", down ? "descending" : "ascending");
        const keyed = [...body.rows].filter((row) => !row.classList.contains("detail")).map((row) => [value(row, column), row]);
        keyed.sort(([a], [b]) => (down ? order(b, a) : order(a, b)));
        body.replaceChildren(...keyed.map(([, row]) => row));
      });
    });
  };

  fathom.all("table.sortable").forEach(fathom.sortable);

  const cells = document.getElementById("cell-table");
  if (cells) {
    fathom.sortable(cells);
    const experiment = document.getElementById("cell-experiment");
    const words = document.getElementById("cell-words");
    const rows = [...cells.tBodies[0].rows];
    const texts = rows.map((row) => row.textContent.toLowerCase());
    const filter = () => {
      const wanted = words.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0;
      rows.forEach((row, index) => {
        const fits = (!experiment.value || row.dataset.experiment === experiment.value)
          && wanted.every((word) => texts[index].includes(word));
        row.hidden = !fits;
        shown += fits;
      });
      fathom.all("tr.detail", cells).forEach((detail) => detail.remove());
      document.getElementById("cell-count").textContent = `${shown} of ${rows.length} cells`;
    };
    experiment.addEventListener("change", filter);
    words.addEventListener("input", filter);
    filter();

    /* The stages of a row's cell, below it. */
    const details = async (row) => {
      const open = row.nextElementSibling?.classList.contains("detail");
      fathom.all("tr.detail", cells).forEach((detail) => detail.remove());
      if (open) return;
      const { runs } = await fathom.data();
      const [run, index] = row.dataset.at.split(" ").map(Number);
      const cell = runs[run].cells[index];
      const lines = cell.stages.map(({ stage, clock, samples, below }) => fathom.element("tr", {},
        fathom.element("td", {}, stage),
        fathom.element("td", { class: "number" }, below === undefined ? fathom.three(fathom.median(samples)) : `< ${fathom.three(below)}`),
        fathom.element("td", {}, clock)));
      const table = fathom.element("table", {}, fathom.element("tbody", {}, ...lines));
      const holder = fathom.element("td", { colspan: row.cells.length }, "Stages, median ms and clock", table);
      row.after(fathom.element("tr", { class: "detail" }, holder));
    };
    cells.tBodies[0].addEventListener("click", (event) => {
      const button = event.target.closest("button.stages");
      if (button) details(button.closest("tr"));
    });
  }

  fathom.open();
}
