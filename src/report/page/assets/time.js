/* Where the time goes: bars in per cent or ms. */
{
  const stacks = fathom.all("#time-frames .stack");
  const longest = Math.max(...stacks.map((stack) => Number(stack.dataset.ms)));
  const unit = document.getElementById("time-unit");
  unit?.addEventListener("change", () => {
    stacks.forEach((stack) => {
      stack.style.width = unit.value === "ms" ? `${(100 * Number(stack.dataset.ms)) / longest}%` : "";
    });
  });
}
