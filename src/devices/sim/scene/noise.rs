//! Random numbers that depend on what they are for, never on the order of calls or on threads.

use rand::SeedableRng as _;
use rand_pcg::Pcg64Mcg;

/// What random numbers are for; each use has a stream of its own.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stream {
    /// When the display began to blink.
    Phase = 1,
    /// The shape of the display.
    Bow,
    /// The lens.
    Lens,
    /// Fixed pattern of the frame camera.
    FixedPattern,
    /// Noise of one exposure.
    Exposure,
    /// Thresholds of the event pixels.
    Thresholds,
    /// Delays of the events of one transition.
    Transition,
    /// Background activity.
    Background,
    /// Which pixels are hot.
    HotPixels,
    /// What the hot pixels fire.
    HotEvents,
    /// Refreshes that the display shows twice.
    Drops,
    /// Delays of what flicker of the backlight fires.
    Flicker,
}

/// The generator of one stream, numbered by two indices such as transition and row.
pub(super) fn rng(seed: u64, stream: Stream, a: u64, b: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(
        [stream as u64, a, b].iter().fold(scramble(seed), |state, v| scramble(state ^ scramble(*v))),
    )
}

/// SplitMix64: neighbouring seeds give unrelated values.
fn scramble(v: u64) -> u64 {
    let v = v.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let v = (v ^ (v >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let v = (v ^ (v >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    v ^ (v >> 31)
}
