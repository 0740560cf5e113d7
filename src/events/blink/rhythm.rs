//! The period of the changes, and how much later each band of rows changes.

use super::super::Event;
use super::RowDelay;

/// Bins of the rate of events, microseconds.
const BIN_US: f64 = 1000.0;
/// The first repetition that is at least this good, against the best, is the period.
const GOOD_ENOUGH: f64 = 0.85;
/// A repetition must look like the beginning by this much (1 is the same).
const ALIKE_MIN: f64 = 0.3;
/// Longest period, microseconds: 1 Hz.
const PERIOD_MAX_US: f64 = 1.05e6;
/// Rows of a band.
const BAND_ROWS: u16 = 16;

fn sign(event: &Event) -> f64 {
    if event.on { 1.0 } else { -1.0 }
}

/// The period by which brighter and darker repeat; `None` without one.
///
/// Sums over one refresh hide a backlight that flickers within it.
pub(super) fn period_us(events: &[Event], refresh_us: f64) -> Option<f64> {
    let (first, last) = (events.first()?.t_us, events.last()?.t_us);
    let bins = ((last - first) as f64 / BIN_US) as usize + 1;
    let mut rate = vec![0.0; bins];
    for event in events {
        if let Some(bin) = rate.get_mut(((event.t_us - first) as f64 / BIN_US) as usize) {
            *bin += sign(event);
        }
    }
    let smooth = box_sum(&rate, ((refresh_us / BIN_US).round() as usize).max(1));
    let alike = |lag: usize| {
        let pairs = smooth.iter().zip(smooth.iter().skip(lag));
        let (mut both, mut early, mut late) = (0.0, 0.0, 0.0);
        for (a, b) in pairs {
            (both, early, late) = (both + a * b, early + a * a, late + b * b);
        }
        both / (early * late).sqrt()
    };
    let shortest = ((1.6 * refresh_us / BIN_US) as usize).max(4);
    let longest = ((PERIOD_MAX_US / BIN_US) as usize).min(bins * 2 / 3);
    let values: Vec<f64> = (0..=longest).map(|lag| if lag < shortest { f64::NAN } else { alike(lag) }).collect();
    let best = values.iter().copied().filter(|v| v.is_finite()).fold(f64::NEG_INFINITY, f64::max);
    let rhythmic = best >= ALIKE_MIN;
    if !rhythmic {
        return None;
    }
    let is_peak = |lag: usize| {
        values[lag] >= GOOD_ENOUGH * best && values[lag - 1] <= values[lag] && values[lag] >= values[lag + 1]
    };
    let lag = (shortest + 1..longest).find(|lag| is_peak(*lag))?;
    Some(lag as f64 * BIN_US)
}

fn box_sum(rate: &[f64], width: usize) -> Vec<f64> {
    let mut sum = 0.0;
    let step = |i: usize| {
        sum += rate[i] - if i >= width { rate[i - width] } else { 0.0 };
        sum
    };
    (0..rate.len()).map(step).collect()
}

/// How much later than the mean of all each band of rows changes, within half a period; bands without events have
/// no entry.
pub(super) fn row_delays(events: &[Event], height: u16, period_us: f64) -> Vec<RowDelay> {
    let bands = usize::from(height.div_ceil(BAND_ROWS));
    // Sums of cosine, sine, rows and events.
    let mut sums = vec![[0.0_f64; 4]; bands];
    let first_us = events.first().map_or(0, |event| event.t_us);
    for event in events {
        let angle = std::f64::consts::TAU * (event.t_us - first_us) as f64 / period_us;
        if let Some(sum) = sums.get_mut(usize::from(event.y / BAND_ROWS)) {
            let [cos, sin, rows, n] = *sum;
            *sum =
                [cos + sign(event) * angle.cos(), sin + sign(event) * angle.sin(), rows + f64::from(event.y), n + 1.0];
        }
    }
    let all = sums.iter().fold([0.0; 2], |a, p| [a[0] + p[0], a[1] + p[1]]);
    let strongest = sums.iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
    let delay = |[cos, sin, rows, n]: &[f64; 4]| {
        // Too few events say nothing about their rows.
        let enough = cos.hypot(*sin) >= 0.01 * strongest && *n > 0.0;
        let (along, across) = (cos * all[0] + sin * all[1], sin * all[0] - cos * all[1]);
        let delay_us = across.atan2(along) / std::f64::consts::TAU * period_us;
        enough.then(|| RowDelay { row_px: rows / n, delay_us })
    };
    sums.iter().filter_map(delay).collect()
}

/// Delay of a row, microseconds: straight between the bands, that of the last band beyond it.
pub(in crate::events) fn delay_of(delays: &[RowDelay], y: u16) -> f64 {
    let row_px = f64::from(y);
    let next = delays.partition_point(|band| band.row_px <= row_px);
    match (next.checked_sub(1).and_then(|i| delays.get(i)), delays.get(next)) {
        (Some(a), Some(b)) => a.delay_us + (row_px - a.row_px) / (b.row_px - a.row_px) * (b.delay_us - a.delay_us),
        (Some(only), None) | (None, Some(only)) => only.delay_us,
        (None, None) => 0.0,
    }
}
