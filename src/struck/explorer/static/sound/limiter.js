/**
 * A limiter that looks ahead: nothing above the ceiling, ever. The state is that of
 * `struck/live/limiter.py`, which explains the four steps; WebAssembly works on the same one.
 */

const [CEILING, RELEASE, FADE_STEP] = [0, 1, 2];
const [CHANNELS, DELAY, HELD, FIRST_LENGTH, SECOND_LENGTH, UNIT] = [3, 4, 5, 6, 7, 8];
const [TIME, RELEASED, FIRST_SUM, SECOND_SUM, OPENING] = [9, 10, 11, 12, 13];
const [OLDEST, NEWEST, REPLACED, LEAST_GAIN, HEAD] = [14, 15, 16, 17, 18];
const NEARLY_OPEN = 1e-9;

export const CEILING_LEVEL = 0.89; // -1 dB
export const places = { REPLACED, LEAST_GAIN };

/** Return by how many samples the limiter is late. */
export const limiterDelay = (sampleRate) => Math.max(1, Math.round(0.0015 * sampleRate));

/**
 * Return a limiter at rest whose output is closed.
 * @param {{sampleRate: number, channels: number}} session
 */
export function limiterState({ sampleRate, channels }) {
  const delay = limiterDelay(sampleRate);
  const held = delay + 1 + Math.round(0.01 * sampleRate);
  const first = Math.floor((delay + 2) / 2);
  const second = delay + 2 - first;
  const state = new Float64Array(HEAD + first + second + 2 * held + channels * delay);
  const unit = 2 ** Math.floor(53 - Math.log2(first * second)); // sums of whole numbers are exact
  const rounded = Math.fround(CEILING_LEVEL);
  state[CEILING] = rounded <= CEILING_LEVEL ? rounded : rounded - 2 ** -24;
  state[RELEASE] = -Math.expm1(-1 / (0.2 * sampleRate));
  state[FADE_STEP] = 1 / Math.max(1, Math.round(0.02 * sampleRate));
  state.set([channels, delay, held, first, second, unit], CHANNELS);
  state.fill(unit, HEAD, HEAD + first);
  state.fill(unit * first, HEAD + first, HEAD + first + second);
  state[RELEASED] = state[LEAST_GAIN] = 1;
  [state[FIRST_SUM], state[SECOND_SUM]] = [unit * first, unit * first * second];
  return state;
}

/**
 * Limit samples in place while the output opens (or stays open) or closes.
 * @param {Float64Array} state of `limiterState`
 * @param {Float64Array} samples (channels, block)
 * @param {number} block
 * @param {boolean} opened
 */
export function limit(state, samples, block, opened) {
  const [channels, delay] = [state[CHANNELS], state[DELAY]];
  const late = state.length - channels * delay;
  const ceiling = state[CEILING];
  state[LEAST_GAIN] = 1;
  for (let k = 0; k < block; k++) {
    const peak = loudest(state, samples, k, channels, block);
    const wanted = held(state, peak > ceiling ? ceiling / peak : 1);
    const gain = smoothed(state, released(state, wanted));
    const fade = faded(state, opened);
    state[LEAST_GAIN] = Math.min(state[LEAST_GAIN], gain);
    for (let channel = 0; channel < channels; channel++) {
      const place = late + channel * delay + (state[TIME] % delay);
      const bounded = Math.min(ceiling, Math.max(-ceiling, state[place] * gain));
      state[place] = samples[channel * block + k];
      samples[channel * block + k] = bounded * fade;
    }
    state[TIME] += 1;
  }
}

/** Return the largest amplitude of all channels; what is not finite becomes 0 and is counted. */
function loudest(state, samples, k, channels, block) {
  let peak = 0;
  for (let place = k; place < channels * block; place += block) {
    if (!Number.isFinite(samples[place])) {
      samples[place] = 0;
      state[REPLACED] += 1;
    }
    peak = Math.max(peak, Math.abs(samples[place]));
  }
  return peak;
}

/** Return the least gain wanted of late; the queue holds times and gains that both rise. */
function held(state, wanted) {
  const size = state[HELD];
  const times = HEAD + state[FIRST_LENGTH] + state[SECOND_LENGTH];
  const gains = times + size;
  let [oldest, newest] = [state[OLDEST], state[NEWEST]];
  if (newest > oldest && state[times + (oldest % size)] <= state[TIME] - size) oldest++;
  while (newest > oldest && state[gains + ((newest - 1) % size)] >= wanted) newest--;
  state[times + (newest % size)] = state[TIME];
  state[gains + (newest % size)] = wanted;
  [state[OLDEST], state[NEWEST]] = [oldest, newest + 1];
  return state[gains + (oldest % size)];
}

function released(state, wanted) {
  const gain = state[RELEASED] + state[RELEASE] * (wanted - state[RELEASED]);
  state[RELEASED] = wanted - gain < NEARLY_OPEN ? wanted : gain;
  return state[RELEASED];
}

/** Return the mean of the means of the last gains, whole numbers of a unit. */
function smoothed(state, gain) {
  const [first, second] = [state[FIRST_LENGTH], state[SECOND_LENGTH]];
  const whole = Math.floor(gain * state[UNIT]);
  let place = HEAD + (state[TIME] % first);
  state[FIRST_SUM] += whole - state[place];
  state[place] = whole;
  place = HEAD + first + (state[TIME] % second);
  state[SECOND_SUM] += state[FIRST_SUM] - state[place];
  state[place] = state[FIRST_SUM];
  return state[SECOND_SUM] / (first * second * state[UNIT]);
}

/** Return the next gain of the fade: a raised cosine, 0 to 1. */
function faded(state, opened) {
  const step = opened ? state[FADE_STEP] : -state[FADE_STEP];
  state[OPENING] = Math.min(1, Math.max(0, state[OPENING] + step));
  return state[OPENING] === 1 ? 1 : Math.sin((Math.PI / 2) * state[OPENING]) ** 2;
}
