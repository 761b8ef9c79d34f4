/* Quality against time: the best settings within the reader's limit. */
{
  const input = document.getElementById("quality-limit");
  const settings = (place) => fathom.all(`[data-of="${place}"] [data-setting]`);

  const fastest = (marks, run) => Math.min(...marks
    .filter((mark) => mark.dataset.run === run).map((mark) => Number(mark.dataset.ms)));

  /* The least error within a multiple of the fastest setting's time; of equal ones the fastest. */
  const best = (marks, run, limit) => marks
    .filter((mark) => mark.dataset.run === run && Number(mark.dataset.ms) <= limit * fastest(marks, run))
    .sort((a, b) => a.dataset.error - b.dataset.error || a.dataset.ms - b.dataset.ms)[0];

  const moveLimit = (line, limit) => {
    const { low, high, log, left, right } = line.dataset;
    const ms = limit * Number(line.dataset.fastest);
    const at = log === "true" ? Math.log10(ms) : ms;
    const share = Math.min(Math.max((at - low) / (high - low), 0), 1);
    const x = Number(left) + share * (right - left);
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
  };

  const update = () => {
    const limit = Number(input.value);
    if (!(limit >= 1)) return;
    fathom.all(".quality-limit").forEach((text) => { text.textContent = limit; });
    fathom.all(".quality line.limit").forEach((line) => moveLimit(line, limit));
    fathom.all(".quality .setting.best").forEach((mark) => mark.classList.remove("best"));
    fathom.all(".quality-table tr[data-comparison]").forEach((row) => {
      const { comparison, run } = row.dataset;
      const marks = settings(comparison);
      const found = best(marks, run, limit);
      row.querySelector(".best-setting").replaceChildren(fathom.element("b", {}, found.dataset.setting));
      row.querySelector(".best-figures").textContent = found.dataset.figures;
      if (found.classList.contains("setting")) found.classList.add("best");
      const words = document.querySelector(`#quality-${comparison} .best[data-run="${run}"] .best-words`);
      if (words) words.textContent = `Best within the limit: ${found.dataset.setting}: ${found.dataset.figures}.`;
    });
  };
  input?.addEventListener("input", update);
}
