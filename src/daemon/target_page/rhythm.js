// Counting refreshes: everything about time, nothing about the page.
//
// Time comes as the stamps of requestAnimationFrame callbacks, in milliseconds. There are no timers.

// Intervals that are looked at before anything blinks, and callbacks before them that are not counted.
export const INTERVALS = 150;
const SETTLE = 10;
// An interval longer than this many periods hides a refresh that nobody drew.
const DROPPED = 1.5;
// Whole refreshes a state: panels of 59.94 Hz are called 60. The same limit as in the cell file.
const EXACT = 0.005;
// Refresh rates that differ by more than this are different.
const CHANGED = 0.01;
// Share of intervals that must be near the usual one.
const STEADY = 0.8;

// Collects callbacks until their rate is known.
export class Refresh {
  #stamps = [];

  // The rate in Hz once there are enough callbacks, else null; NaN where they come unevenly.
  add(stamp) {
    this.#stamps.push(stamp);
    if (this.#stamps.length < SETTLE + INTERVALS + 1) return null;
    const stamps = this.#stamps.slice(SETTLE);
    const intervals = stamps.slice(1).map((t, i) => t - stamps[i]);
    const sorted = [...intervals].sort((a, b) => a - b);
    const usual = sorted[sorted.length >> 1];
    const good = intervals.filter((i) => i > 0.5 * usual && i < DROPPED * usual);
    if (!(usual > 0) || good.length < STEADY * intervals.length) return NaN;
    return (1000 * good.length) / good.reduce((sum, i) => sum + i, 0);
  }
}

// How many refreshes a state has, or what could be had instead, the nearest first.
export function fit(refreshHz, cycleHz) {
  const wanted = refreshHz / (2 * cycleHz);
  const k = Math.max(1, Math.round(wanted));
  if (Math.abs(wanted / k - 1) <= EXACT) return { k, offers: [] };
  const ks = [...new Set([Math.max(1, Math.floor(wanted)), Math.max(1, Math.ceil(wanted))])];
  const offers = ks.map((n) => refreshHz / (2 * n));
  offers.sort((a, b) => Math.abs(a - cycleHz) - Math.abs(b - cycleHz));
  return { k: null, offers };
}

// The alternation: state = floor(n / k) mod 2 at refresh n.
export class Rhythm {
  #periodMs;
  #last = null;
  #near = { seen: 0, count: 0, sum: 0 };

  constructor(refreshHz, k) {
    this.#periodMs = 1000 / refreshHz;
    this.k = k;
    this.n = 0;
    this.dropped = 0;
  }

  // Refresh n: which state it shows, how many refreshes before it nobody drew, whether the rate has changed.
  next(stamp) {
    const interval = this.#last === null ? this.#periodMs : stamp - this.#last;
    this.#last = stamp;
    const dropped = interval > DROPPED * this.#periodMs ? Math.max(1, Math.round(interval / this.#periodMs) - 1) : 0;
    this.dropped += dropped;
    const n = this.n++;
    return { n, state: Math.floor(n / this.k) % 2, dropped, changed: this.#changed(interval) };
  }

  // Looks at every 150 intervals: a mean that is off, or mostly dropped refreshes, is another rate.
  #changed(interval) {
    const near = this.#near;
    near.seen += 1;
    if (interval <= DROPPED * this.#periodMs) {
      near.count += 1;
      near.sum += interval;
    }
    if (near.seen < INTERVALS) return false;
    this.#near = { seen: 0, count: 0, sum: 0 };
    const off = Math.abs(near.sum / near.count / this.#periodMs - 1);
    return near.count < INTERVALS / 2 || off > CHANGED;
  }
}

// The last refreshes, without making garbage sixty times a second.
export class History {
  #size = 1200;
  #n = new Float64Array(this.#size);
  #state = new Uint8Array(this.#size);
  #dropped = new Uint16Array(this.#size);
  #count = 0;

  add({ n, state, dropped }) {
    const at = this.#count++ % this.#size;
    this.#n[at] = n;
    this.#state[at] = state;
    this.#dropped[at] = Math.min(dropped, 65535);
  }

  // Oldest first: [n, state, refreshes dropped before it].
  list() {
    const from = Math.max(0, this.#count - this.#size);
    return Array.from({ length: this.#count - from }, (_, i) => {
      const at = (from + i) % this.#size;
      return [this.#n[at], this.#state[at], this.#dropped[at]];
    });
  }
}
