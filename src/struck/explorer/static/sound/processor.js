/** The worklet: it hands the browser what `synthesis.js` makes, and counts what came too late. */
import { Ring } from './commands.js';
import { WasmKit } from './core.js';
import { SinglePoint, headOf } from './head.js';
import { PlainKit } from './plain.js';
import { REPORT, Synthesis } from './synthesis.js';

const SAID = 0.05; // s between reports
const WINDOW = 250; // ms of which the least lag counts: buffers are asked for in bursts
const GAP = 4; // ms of lag more than in the window before: so much sound was lost

/** How far sound lags behind the clock: a device that got a buffer too late lost that time. */
class Watch {
  constructor() {
    this.underruns = 0;
    this.before = this.least = Infinity;
    this.working = 0;
    this.begun = this.since = Date.now();
  }

  /** Note that sound has gone on up to a time, s; Date is the only clock of a worklet. */
  note(time) {
    const now = Date.now();
    this.least = Math.min(this.least, now - 1000 * time);
    if (now < this.begun + WINDOW) return;
    if (this.least > this.before + GAP) this.underruns++;
    this.before = this.least;
    this.least = Infinity;
    this.begun = now;
  }

  /** Return the share of the time that was spent working. */
  load() {
    const now = Date.now();
    const share = this.working / Math.max(now - this.since, 1);
    this.working = 0;
    this.since = now;
    return share;
  }
}

/** Return the head of tables, or one ear without them. */
const headFrom = (given) => (given ? headOf(given.text, given.tensors) : new SinglePoint());

class StruckProcessor extends AudioWorkletProcessor {
  constructor({ processorOptions: given, outputChannelCount: [channels] }) {
    super();
    const session = { sampleRate, channels };
    const kit = given.core ? new WasmKit(given.core, session) : new PlainKit(session);
    this.synthesis = new Synthesis(kit, headFrom(given.head), { voices: given.voices, start: currentFrame });
    this.ring = given.ring ? new Ring(given.ring) : null;
    this.watch = given.realTime ? new Watch() : null;
    this.next = 0;
    this.alive = true;
    this.port.onmessage = ({ data }) => this.#receive(data);
  }

  #receive(data) {
    this.ring?.read(this.synthesis.take); // what was said before this message
    if (data instanceof Float64Array) this.synthesis.post(data);
    else if (data.add) {
      this.synthesis.add(data.number, data.add);
      this.port.postMessage('added');
    } else if (data.ask) this.port.postMessage(data.ask);
    else if ('head' in data) this.synthesis.setHead(headFrom(data.head));
    else if (data.close) this.alive = false;
    else if (data.burn) this.burn = data.burn; // tests overload it on purpose
  }

  process(_inputs, [outputs]) {
    const begun = this.watch ? Date.now() : 0;
    this.ring?.read(this.synthesis.take);
    this.synthesis.process(outputs, currentFrame);
    if (this.synthesis.struck) {
      this.synthesis.report[REPORT.STRUCK] = Date.now();
      this.synthesis.struck = false;
    }
    if (this.burn) for (const end = begun + this.burn; Date.now() < end;);
    if (this.watch) {
      this.watch.note(currentTime);
      this.watch.working += Date.now() - begun;
    }
    // On the clock by the clock: one that is overloaded tells so as often.
    const now = this.watch ? Date.now() / 1000 : currentTime;
    if (now >= this.next) this.#report(now);
    return this.alive;
  }

  #report(now) {
    const report = this.synthesis.told();
    if (this.watch) {
      report[REPORT.UNDERRUNS] = this.watch.underruns;
      report[REPORT.LOAD] = this.watch.load();
    }
    this.port.postMessage(report);
    report[REPORT.PEAK] = 0;
    this.next = now + SAID;
  }
}

registerProcessor('struck', StruckProcessor);
