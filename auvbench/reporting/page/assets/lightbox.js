// Figures enlarged in a dialog: Escape closes, arrow keys lead to the neighbours.
(() => {
  "use strict";
  const dialog = document.getElementById("lightbox");
  if (!dialog) return;
  const buttons = [...document.querySelectorAll(".enlarge")];
  const image = dialog.querySelector("img");
  const caption = dialog.querySelector(".caption");
  let current = 0;

  function show(place) {
    current = (place + buttons.length) % buttons.length;
    const source = buttons[current].querySelector("img");
    image.src = source.src;
    image.alt = source.alt;
    caption.textContent = buttons[current].closest("figure").querySelector("figcaption b").textContent;
    if (!dialog.open) dialog.showModal();
  }

  buttons.forEach((button, place) => button.addEventListener("click", () => show(place)));
  dialog.addEventListener("click", (event) => {
    const move = event.target.dataset?.move;
    if (move) show(current + Number(move));
    else if (event.target === dialog || "close" in (event.target.dataset ?? {})) dialog.close();
  });
  dialog.addEventListener("keydown", (event) => {
    if (event.key === "ArrowRight") show(current + 1);
    if (event.key === "ArrowLeft") show(current - 1);
  });
  dialog.addEventListener("close", () => buttons[current].focus());
})();
