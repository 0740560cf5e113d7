//! Transitions: bursts of events of one sign, once all rows are brought to one time.

use super::super::Event;

/// Bins of the rate of events, microseconds.
const BIN_US: f64 = 500.0;
/// A burst rises above this share of the strongest ones.
const BURST: f64 = 0.2;

/// All pixels change together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Burst {
    /// Median time of its events, microseconds.
    pub(super) at_us: f64,
    /// Whether they got brighter.
    pub(super) brighter: bool,
    events: usize,
}

/// The transitions in order, brighter and darker in turn.
pub(super) fn bursts(events: &[Event], delay_us: &dyn Fn(u16) -> f64, period_us: f64) -> Vec<Burst> {
    let mut times: Vec<(f64, bool)> = events.iter().map(|e| (e.t_us as f64 - delay_us(e.y), e.on)).collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some((first, last)) = times.first().zip(times.last()).map(|(a, b)| (a.0, b.0)) else { return Vec::new() };
    let mut rate = vec![0.0; ((last - first) / BIN_US) as usize + 1];
    for (at, on) in &times {
        if let Some(bin) = rate.get_mut(((at - first) / BIN_US) as usize) {
            *bin += if *on { 1.0 } else { -1.0 };
        }
    }
    // Sums over an eighth of a period join the few milliseconds in which pixels answer.
    let half = ((period_us / 16.0 / BIN_US) as usize).max(1);
    let smooth: Vec<f64> =
        (0..rate.len()).map(|i| rate[i.saturating_sub(half)..(i + half + 1).min(rate.len())].iter().sum()).collect();
    let mut sizes: Vec<f64> = smooth.iter().map(|v| v.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let strong = sizes.get(sizes.len() * 95 / 100).copied().unwrap_or(0.0);
    let mut found: Vec<(bool, f64, f64)> = Vec::new();
    for (i, value) in smooth.iter().enumerate().filter(|(_, v)| v.abs() > BURST * strong) {
        let (from, to) = (first + i as f64 * BIN_US, first + (i + 1) as f64 * BIN_US);
        match found.last_mut() {
            Some(last) if last.0 == (*value > 0.0) => last.2 = to,
            Some(_) | None => found.push((*value > 0.0, from, to)),
        }
    }
    let mut all: Vec<Burst> =
        found.into_iter().filter_map(|(brighter, from, to)| burst(&times, brighter, from, to)).collect();
    let mut sizes: Vec<usize> = all.iter().map(|burst| burst.events).collect();
    sizes.sort_unstable();
    let usual = sizes.get(sizes.len() / 2).copied().unwrap_or(0);
    all.retain(|burst| burst.events as f64 >= BURST * usual as f64);
    all
}

fn burst(times: &[(f64, bool)], brighter: bool, from: f64, to: f64) -> Option<Burst> {
    let start = times.partition_point(|(at, _)| *at < from);
    let inside = times[start..].iter().take_while(|(at, _)| *at < to).filter(|(_, on)| *on == brighter);
    let of_sign: Vec<f64> = inside.map(|(at, _)| *at).collect();
    // Sorted already.
    of_sign.get(of_sign.len() / 2).map(|at_us| Burst { at_us: *at_us, brighter, events: of_sign.len() })
}
