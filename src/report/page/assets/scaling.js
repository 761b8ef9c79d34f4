/* How it scales: only the charts of a stage. */
{
  const choice = document.getElementById("scaling-stage");
  const figures = fathom.all("figure.multiple[data-stages]").map((figure) => [figure, figure.dataset.stages.split("\n")]);
  const filter = () => {
    let shown = 0;
    figures.forEach(([figure, stages]) => {
      figure.hidden = Boolean(choice.value) && !stages.includes(choice.value);
      shown += !figure.hidden;
    });
    fathom.all(".scaling-experiment").forEach((part) => {
      part.hidden = !part.querySelector("figure.multiple:not([hidden])");
    });
    document.getElementById("scaling-count").textContent = `${shown} of ${figures.length} charts`;
  };
  if (choice) {
    choice.addEventListener("change", filter);
    filter();
  }
}
