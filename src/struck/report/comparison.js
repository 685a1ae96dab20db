// One side plays at a time; the button goes on with the other from the same moment.
const [a, b] = document.querySelectorAll(".sounds audio");
for (const [one, other] of [[a, b], [b, a]])
  one.addEventListener("play", () => other.pause());
document.getElementById("switch").addEventListener("click", () => {
  const [now, next] = b.paused ? [a, b] : [b, a];
  const playing = !now.paused && !now.ended;
  const chosen = playing ? next : a;
  chosen.currentTime = playing ? now.currentTime : 0;
  now.pause();
  chosen.play();
});
