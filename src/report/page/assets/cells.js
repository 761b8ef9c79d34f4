/* Tables: sorting by a heading, filters. */
{
  const value = (row, column) => {
    const cell = row.cells[column];
    return cell?.dataset.v === undefined ? cell?.textContent.trim() ?? "" : Number(cell.dataset.v);
  };
  const order = (a, b) => (typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true }));

  /* Makes the headings of a table sort, but those above buttons: `arrange` gets rows and where they go. Rows without a value stay
     last. */
  fathom.sortable = (table, rows, arrange) => {
    [...table.tHead.rows[0].cells].forEach((heading, column) => {
      if (heading.classList.contains("script-only")) return;
      const button = fathom.element("button", { class: "sort", type: "button" }, heading.textContent);
      heading.replaceChildren(button);
      button.addEventListener("click", () => {
        const down = heading.getAttribute("aria-sort") === "ascending";
        fathom.all("[aria-sort]", table.tHead).forEach((other) => other.removeAttribute("aria-sort"));
        heading.setAttribute("aria-sort", down ? "descending" : "ascending");
        const keyed = rows.map((row) => [value(row, column), row]);
        const kind = keyed.some(([key]) => typeof key === "number") ? "number" : "string";
        const has = ([key]) => typeof key === kind && key !== "";
        const sorted = keyed.filter(has).sort(([a], [b]) => (down ? order(b, a) : order(a, b)));
        arrange([...sorted, ...keyed.filter((pair) => !has(pair))].map(([, row]) => row));
      });
    });
  };

  fathom.all("table.sortable").forEach((table) => {
    const body = table.tBodies[0];
    fathom.sortable(table, [...body.rows], (rows) => body.replaceChildren(...rows));
  });

  const matcher = (words) => {
    const wanted = words.toLowerCase().split(/\s+/).filter(Boolean);
    return (text) => wanted.every((word) => text.toLowerCase().includes(word));
  };

  /* Claims that hold all words; what is folded is opened to show them. */
  const lead = document.querySelector("#claims > details > p");
  if (lead) {
    const words = fathom.element("input", { id: "claim-words", type: "search", size: 24 });
    lead.after(fathom.element("div", { class: "controls" }, fathom.element("label", {}, "Holds the words ", words)));
    const folds = fathom.all("#claims details details").filter((fold) => fold.querySelector("table.claims"));
    words.addEventListener("input", () => {
      const matches = matcher(words.value);
      let claim = "";
      for (const row of fathom.all("#claims table.claims > tbody > tr")) {
        claim = row.querySelector(".source") ? row.textContent : claim;
        row.hidden = !matches(claim + row.textContent);
      }
      folds.forEach((fold) => { fold.open = words.value !== ""; });
    });
  }

  const cells = document.getElementById("cell-table");
  if (cells) {
    const body = cells.tBodies[0];
    const experiment = document.getElementById("cell-experiment");
    const words = document.getElementById("cell-words");
    const more = document.getElementById("cell-more");
    const all = [...body.rows];
    const text = (row) => `${row.textContent} ${row.querySelector("th[title]")?.title ?? ""}`;
    const texts = new Map(all.map((row) => [row, text(row)]));
    let rows = all;
    /* Of a long table only the first rows are laid out, which is what takes the time. */
    const few = fathom.isNarrow() ? 40 : 200;
    let most = few;

    const show = () => {
      const matches = matcher(words.value);
      const fitting = rows.filter((row) => (!experiment.value || row.dataset.experiment === experiment.value)
        && matches(texts.get(row)));
      body.replaceChildren(...fitting.slice(0, most));
      more.hidden = fitting.length <= most;
      more.textContent = `show all ${fitting.length} cells`;
      document.getElementById("cell-count").textContent = `${fitting.length} of ${all.length} cells`;
    };
    const filter = () => {
      most = few;
      show();
    };
    const whole = () => {
      most = Infinity;
      show();
    };
    fathom.sortable(cells, all, (sorted) => {
      rows = sorted;
      show();
    });
    experiment.addEventListener("change", filter);
    words.addEventListener("input", filter);
    more.addEventListener("click", whole);
    addEventListener("beforeprint", whole);
    show();

    const line = (parts) => fathom.element("tr", {}, ...parts.map((part, place) =>
      fathom.element("td", place > 0 && place < 5 ? { class: "number" } : {}, part)));

    /* The stages of a row's cell, below it. */
    const details = async (row) => {
      const open = row.nextElementSibling?.classList.contains("detail");
      fathom.all("tr.detail", cells).forEach((detail) => detail.remove());
      if (open) return;
      const { runs } = await fathom.data();
      const [run, index] = row.dataset.at.split(" ").map(Number);
      const lines = runs[run][index].map(line);
      const heads = ["Stage", "Median (ms)", "Minimum", "Maximum", "n", "Clock"];
      const table = fathom.element("table", {},
        fathom.element("thead", {}, fathom.element("tr", {}, ...heads.map((head) => fathom.element("th", { scope: "col" }, head)))),
        fathom.element("tbody", {}, ...lines));
      fathom.nameCells(table);
      const holder = fathom.element("td", { colspan: row.cells.length }, table);
      row.after(fathom.element("tr", { class: "detail" }, holder));
    };
    cells.tBodies[0].addEventListener("click", (event) => {
      const button = event.target.closest("button.stages");
      if (button) details(button.closest("tr"));
    });
  }

  /* All parts of the page are ready: the last script. */
  fathom.controls().forEach((control) => {
    if (!control.disabled) control.dataset.first = control.value;
    const keep = () => fathom.keep(control.closest("section").id);
    control.addEventListener(control.matches("select") ? "change" : "input", keep);
  });
  fathom.restore();
}
