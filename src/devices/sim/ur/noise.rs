//! Seeded randomness that depends on what it is for and on when, never on who asked first.

use rand::{Rng as _, SeedableRng as _};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

/// What the numbers are for; each has its own stream.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stream {
    /// The arm as it was built.
    Individual = 1,
    /// What happens at the n-th stop.
    Stop = 2,
    /// Where the n-th move settles.
    Settling = 4,
    /// What is measured in the n-th tick.
    Measured = 3,
    /// What a bad network does to the n-th package.
    Network = 5,
    /// What a program calls random in the n-th tick.
    Script = 6,
}

/// The generator of the `index`-th draw of a stream.
pub(super) fn generator(seed: u64, stream: Stream, index: u64) -> Pcg64Mcg {
    // Odd constants of the splitmix generator spread neighbouring indices over the whole range.
    let mixed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ index.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    Pcg64Mcg::seed_from_u64(mixed.rotate_left(17) ^ (stream as u64).wrapping_mul(0x94d0_49bb_1331_11eb))
}

/// Uniform in `range`, smallest and largest value.
pub(super) fn between(rng: &mut Pcg64Mcg, range: [f64; 2]) -> f64 {
    range[0] + (range[1] - range[0]) * rng.random::<f64>()
}

/// `N` independent normal numbers of this standard deviation.
pub(super) fn normal<const N: usize>(rng: &mut Pcg64Mcg, sigma: f64) -> [f64; N] {
    std::array::from_fn(|_| sigma * rng.sample::<f64, _>(StandardNormal))
}
