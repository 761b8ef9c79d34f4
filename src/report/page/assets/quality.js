/* Quality against time: the best settings within the reader's limit. */
{
  const input = document.getElementById("quality-limit");
  const settings = (place) => fathom.all(`[data-of="${place}"] [data-setting]`);

  /* The least error within the limit; of equal ones the fastest. */
  const best = (marks, run, limit) => marks
    .filter((mark) => mark.dataset.run === run && Number(mark.dataset.ms) <= limit)
    .sort((a, b) => a.dataset.error - b.dataset.error || a.dataset.ms - b.dataset.ms)[0];

  const moveLimit = (line, limit) => {
    const { low, high, log, left, right } = line.dataset;
    const at = log === "true" ? Math.log10(Math.max(limit, 1e-9)) : limit;
    const share = Math.min(Math.max((at - low) / (high - low), 0), 1);
    const x = Number(left) + share * (right - left);
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
  };

  /* Why there is no best setting. */
  const none = (marks, run) => {
    const times = marks.filter((mark) => mark.dataset.run === run).map((mark) => Number(mark.dataset.ms));
    return `none: the fastest takes ${fathom.three(Math.min(...times))} ms`;
  };

  const update = () => {
    const limit = Number(input.value);
    if (!(limit > 0)) return;
    fathom.all(".quality-limit").forEach((text) => { text.textContent = fathom.three(limit); });
    fathom.all(".quality line.limit").forEach((line) => moveLimit(line, limit));
    fathom.all(".quality .setting.best").forEach((mark) => mark.classList.remove("best"));
    fathom.all(".quality-table tr[data-comparison]").forEach((row) => {
      const { comparison, run } = row.dataset;
      const marks = settings(comparison);
      const found = best(marks, run, limit);
      row.querySelector(".best-setting").replaceChildren(found
        ? fathom.element("b", {}, found.dataset.setting)
        : fathom.element("span", { class: "faint" }, none(marks, run)));
      row.querySelector(".best-figures").textContent = found ? found.dataset.figures : "";
      if (found?.classList.contains("setting")) found.classList.add("best");
      const words = document.querySelector(`#quality-${comparison} .best[data-run="${run}"] .best-words`);
      if (words) {
        words.textContent = found
          ? `Best of at most ${fathom.three(limit)} ms: ${found.dataset.setting}: ${found.dataset.figures}.`
          : `Best of at most ${fathom.three(limit)} ms: ${none(marks, run)}.`;
      }
    });
  };
  input?.addEventListener("input", update);
}
