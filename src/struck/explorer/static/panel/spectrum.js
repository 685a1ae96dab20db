/** Spectrum and level of what is heard, drawn while there is something to see. */

const LOWEST = 20;
const HIGHEST = 20_000; // Hz
const [FLOOR, TOP] = [-110, -10]; // dB
const GRID = [100, 1000, 10_000];
const OFTEN = 33; // ms between two pictures

export class Spectrum {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.meter = document.getElementById('meter');
    this.words = document.getElementById('level-shown');
    this.marks = [];
    this.level = -Infinity;
    this.last = 0;
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  /** Follow what an analyser hears. */
  follow(analyser) {
    this.analyser = analyser;
    this.bins = new Float32Array(analyser.frequencyBinCount);
    this.samples = new Float32Array(2048);
  }

  /** Mark the frequencies of the chosen object, Hz, and one of them above the others. */
  mark(frequencies, chosen = null) {
    this.marks = frequencies;
    this.chosen = chosen;
    this.draw();
  }

  /** Draw, where it is time for it; return whether there is something to hear. */
  tick() {
    if (!this.analyser) return false;
    const now = performance.now();
    if (now - this.last < OFTEN) return true;
    this.last = now;
    this.analyser.getFloatFrequencyData(this.bins);
    this.analyser.getFloatTimeDomainData(this.samples);
    const peak = this.samples.reduce((most, sample) => Math.max(most, Math.abs(sample)), 0);
    this.level = 20 * Math.log10(peak || 1e-9);
    this.meter.value = Math.max(-60, this.level);
    this.words.textContent = this.level < -90 ? 'silent' : `${this.level.toFixed(0)} dB`;
    this.draw();
    return this.level > -90;
  }

  draw() {
    const ratio = Math.min(devicePixelRatio, 2);
    const [width, height] = [this.canvas.clientWidth * ratio, this.canvas.clientHeight * ratio];
    if (!width) return;
    if (this.canvas.width !== Math.round(width)) [this.canvas.width, this.canvas.height] = [Math.round(width), Math.round(height)];
    const pen = this.canvas.getContext('2d');
    pen.clearRect(0, 0, width, height);
    const x = (frequency) => (Math.log(frequency / LOWEST) / Math.log(HIGHEST / LOWEST)) * width;
    const y = (decibels) => ((TOP - decibels) / (TOP - FLOOR)) * height;
    pen.font = `${10.5 * ratio}px system-ui, sans-serif`;
    for (const frequency of GRID) {
      pen.fillStyle = '#ffffff26';
      pen.fillRect(x(frequency), 0, ratio, height);
      pen.fillStyle = '#ffffff8c';
      const right = x(frequency) < 0.85 * width; // of its line, where there is room
      pen.textAlign = right ? 'left' : 'right';
      pen.fillText(frequency < 1000 ? `${frequency} Hz` : `${frequency / 1000} kHz`, x(frequency) + (right ? 4 : -4) * ratio, height - 4 * ratio);
    }
    pen.fillStyle = '#7fb7d066';
    for (const frequency of this.marks) pen.fillRect(x(frequency), 0, ratio, 5 * ratio);
    if (this.chosen) {
      pen.fillStyle = '#ffd9a0';
      pen.fillRect(x(this.chosen) - ratio / 2, 0, 2 * ratio, height);
    }
    if (this.analyser) this.#curve(pen, x, y, height, ratio);
  }

  #curve(pen, x, y, height, ratio) {
    const step = this.analyser.context.sampleRate / this.analyser.fftSize;
    const gradient = pen.createLinearGradient(0, 0, 0, height);
    gradient.addColorStop(0, '#f2a65ae6');
    gradient.addColorStop(1, '#f2a65a14');
    pen.beginPath();
    pen.moveTo(0, height);
    const first = Math.max(1, Math.round(LOWEST / step));
    for (let bin = first; bin < this.bins.length && bin * step < HIGHEST; bin += 1) {
      pen.lineTo(x(bin * step), Math.min(height, y(Math.max(FLOOR, this.bins[bin]))));
    }
    pen.lineTo(this.canvas.width, height);
    pen.fillStyle = gradient;
    pen.fill();
    pen.strokeStyle = '#f2a65a';
    pen.lineWidth = ratio;
    pen.stroke();
  }
}
