// A button goes on where the sound that plays is; one that plays silences all others.
for (const hit of document.querySelectorAll(".hit")) {
  const sounds = [...hit.querySelectorAll("audio")];
  hit.querySelectorAll("button").forEach((button, which) => button.addEventListener("click", () => {
    const now = sounds.find((each) => !each.paused && !each.ended);
    const next = sounds[which];
    if (now === next) return next.pause();
    next.currentTime = now ? now.currentTime : 0;
    if (now) now.pause();
    next.play();
  }));
}
for (const kind of ["play", "pause", "ended"])
  document.addEventListener(kind, (event) => {
    event.target.closest("figure").classList.toggle("playing", kind === "play");
    if (kind === "play")
      for (const each of document.querySelectorAll("audio"))
        if (each !== event.target) each.pause();
  }, true);
// A heading sorts, and turns the order round; what is no number comes last.
for (const table of document.querySelectorAll(".sortable table")) {
  const [headings] = table.tHead.rows;
  const [body] = table.tBodies;
  [...headings.cells].forEach((heading, column) => heading.addEventListener("click", () => {
    const down = heading.dataset.order === "up";
    for (const each of headings.cells) delete each.dataset.order;
    heading.dataset.order = down ? "down" : "up";
    const text = (row) => row.cells[column].textContent;
    const compare = (one, other) => {
      const [a, b] = [text(one), text(other)];
      if (isNaN(a) !== isNaN(b)) return isNaN(a) ? 1 : -1;
      const order = isNaN(a) ? a.localeCompare(b) : a - b;
      return down ? -order : order;
    };
    body.append(...[...body.rows].sort(compare));
  }));
}
