//! Finds which edge starts which exposure, from times on two clocks that differ by an offset and a drift.
//!
//! Every two exposures far apart and every two edges about as far apart propose a map; a map that puts an edge at many
//! exposures is fitted by robust least squares. The best one must beat every other one, or nothing is returned.
//! Closing pulses are too loosely timed for the fit, but where one belongs after each pose they are evidence too.

use std::collections::HashSet;

use super::edges::Edges;
use super::windows::{EXPOSURE_PART_MIN, PERIODS_MAX};
use super::{ClockMap, DRIFT_MAX_PPM, ExposureTime, PAIRS_MIN, RESIDUAL_PERIODS, SyncError, SyncSettings};
use super::TOLERANCE_PERIODS;

/// Exposures whose pairs propose maps; fewer for long sessions, where the work grows with the number of edges.
const ANCHORS: usize = 12;
const ANCHORS_OF_MANY: usize = 6;
const MANY_EDGES: usize = 3000;
/// Exposures on which a map is tried before all are, and the part of them that must have an edge.
const PROBES: usize = 32;
const PROBES_MATCHED_MIN: f64 = 0.35;
/// Part of the exposures that must have an edge.
const MATCHED_MIN: f64 = 0.5;
/// Standard deviations from the fit at which a pair leaves it.
const OUTLIER_SIGMAS: f64 = 6.0;
/// Noise below this is not told apart: times are whole microseconds.
const SIGMA_MIN_S: f64 = 5e-6;
/// How much the drift is expected to be, before the data are seen; matters in sessions of seconds only.
const DRIFT_EXPECTED: f64 = 100e-6;

/// The one map that explains the edges.
#[derive(Debug, Clone)]
pub(super) struct Aligned {
    pub(super) clock: ClockMap,
    /// For each exposure as given, the index of its rising edge.
    pub(super) pairs: Vec<Option<usize>>,
    /// Over the pairs in the fit.
    pub(super) rms_s: f64,
    /// Pairs that were too far off to enter the fit.
    outliers: usize,
}

impl Aligned {
    /// A remark on pairs that are far off.
    pub(super) fn note(&self) -> Option<String> {
        (self.outliers > 0).then(|| {
            format!("{} exposures are far off their trigger edge for a noise of {:.6} s", self.outliers, self.rms_s)
        })
    }
}

/// Pairs exposures, in any order, with rising edges; `None` where no map pairs enough of them.
pub(super) fn align(
    exposures: &[ExposureTime],
    edges: &Edges,
    settings: &SyncSettings,
) -> Result<Option<Aligned>, SyncError> {
    let mut order: Vec<usize> = (0..exposures.len()).collect();
    order.sort_by(|&a, &b| exposures[a].start_host_s.total_cmp(&exposures[b].start_host_s));
    let ordered: Vec<ExposureTime> = order.iter().map(|&index| exposures[index]).collect();
    let starts = edges.starts();
    let Some(problem) = Problem::new(&ordered, edges, &starts, settings) else { return Ok(None) };
    let candidates = problem.candidates();
    let Some(best) = problem.choose(&candidates)? else { return Ok(None) };
    let limit_s = problem.period_s * RESIDUAL_PERIODS;
    if !(best.rms_s(|_| true) <= limit_s) {
        return Err(SyncError::Residual { residual_rms_s: best.rms_s(|_| true), limit_s });
    }
    let mut pairs = vec![None; exposures.len()];
    for (&index, pair) in order.iter().zip(&best.pairs) {
        pairs[index] = pair.map(|start| starts[start]);
    }
    let outlier_s = best.outlier_s();
    let outliers = best.residuals_s.iter().filter(|r| !(r.abs() <= outlier_s)).count();
    let rms_s = best.rms_s(|r| r.abs() <= outlier_s);
    Ok(Some(Aligned { clock: problem.clock(best.line), pairs, rms_s, outliers }))
}

/// `host = offset + (1 + drift) * sensor`, both in seconds since the references of a [`Problem`].
#[derive(Debug, Clone, Copy)]
struct Line {
    offset_s: f64,
    drift: f64,
}

impl Line {
    fn sensor_s(self, host_s: f64) -> f64 {
        (host_s - self.offset_s) / (1.0 + self.drift)
    }

    fn residual_s(self, host_s: f64, sensor_s: f64) -> f64 {
        host_s - self.offset_s - (1.0 + self.drift) * sensor_s
    }
}

/// A fitted map and what it pairs.
#[derive(Debug, Clone)]
struct Candidate {
    line: Line,
    pairs: Vec<Option<usize>>,
    /// Of the pairs, in order.
    residuals_s: Vec<f64>,
    /// Noise of the pairs, from the median of their residuals.
    sigma_s: f64,
    /// Poses with a closing pulse after their last exposure.
    closed: usize,
}

impl Candidate {
    fn matched(&self) -> usize {
        self.residuals_s.len()
    }

    /// Pulses that are where they belong.
    fn explained(&self) -> usize {
        self.matched() + self.closed
    }

    fn outlier_s(&self) -> f64 {
        OUTLIER_SIGMAS * self.sigma_s
    }

    fn rms_s(&self, wanted: impl Fn(f64) -> bool) -> f64 {
        let squares: Vec<f64> = self.residuals_s.iter().filter(|r| wanted(**r)).map(|r| r * r).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    /// Whether it fits so much better than `other` that chance cannot be the reason.
    ///
    /// The bound on the ratio of variances is about the 99.9 % point of the F distribution, widened because medians
    /// are rough.
    fn is_quieter_than(&self, other: &Self) -> bool {
        let freedom = self.matched().min(other.matched()).saturating_sub(2).max(1) as f64;
        (other.sigma_s / self.sigma_s).powi(2) > 1.0 + 40.0 / freedom.sqrt()
    }
}

/// Times on both clocks, in seconds since a reference on each, so that no precision is lost to large offsets.
struct Problem {
    hosts_s: Vec<f64>,
    sensors_s: Vec<f64>,
    /// Starts of the last exposure of each pose, on the host's clock.
    last_hosts_s: Vec<f64>,
    /// Closing pulses, on the sensor's clock.
    closing_s: Vec<f64>,
    /// From the start of a last exposure, when its closing pulse may begin.
    closing_after_s: [f64; 2],
    host_reference_s: f64,
    sensor_reference_s: f64,
    /// Shortest time from one exposure to the next.
    period_s: f64,
    tolerance_s: f64,
}

impl Problem {
    /// `exposures` in order of time; `starts` the indices of the edges that can start one.
    fn new(exposures: &[ExposureTime], edges: &Edges, starts: &[usize], settings: &SyncSettings) -> Option<Self> {
        let host_reference_s = exposures.first()?.start_host_s;
        let reference_us = edges.rising[*starts.first()?].t_us;
        let host_s = |exposure: &ExposureTime| exposure.start_host_s - host_reference_s;
        let sensor_s = |index: usize| edges.rising[index].t_us.saturating_sub(reference_us) as f64 * 1e-6;
        let hosts_s: Vec<f64> = exposures.iter().map(host_s).collect();
        let period_s = hosts_s.windows(2).map(|pair| pair[1] - pair[0]).fold(settings.frame_period_s, f64::min);
        let poses = exposures.chunk_by(|a, b| a.pose == b.pose);
        Some(Self {
            hosts_s,
            sensors_s: starts.iter().map(|&index| sensor_s(index)).collect(),
            last_hosts_s: poses.filter_map(|pose| pose.last()).map(host_s).collect(),
            closing_s: (0..edges.rising.len()).filter(|&i| edges.rising[i].closing).map(sensor_s).collect(),
            closing_after_s: [EXPOSURE_PART_MIN * settings.exposure_s, PERIODS_MAX * settings.frame_period_s],
            host_reference_s,
            sensor_reference_s: reference_us as f64 * 1e-6,
            period_s,
            tolerance_s: period_s * TOLERANCE_PERIODS,
        })
    }

    fn clock(&self, line: Line) -> ClockMap {
        let offset_s = self.host_reference_s + line.offset_s - (1.0 + line.drift) * self.sensor_reference_s;
        ClockMap { offset_s, ppm: line.drift * 1e6 }
    }

    fn span_s(&self) -> f64 {
        self.hosts_s.last().copied().unwrap_or(0.0)
    }

    /// All fitted maps that pair enough, each once.
    fn candidates(&self) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = Vec::new();
        let mut tried = HashSet::new();
        let probes = spread(self.hosts_s.len(), PROBES);
        let needed = (MATCHED_MIN * self.hosts_s.len() as f64).ceil().max(PAIRS_MIN as f64) as usize;
        self.propose(|line| {
            if !self.passes(line, &probes) || !tried.insert(self.key(line)) {
                return;
            }
            let Some(candidate) = self.fit(line) else { return };
            if candidate.matched() >= needed && !found.iter().any(|other| self.is_same(other.line, candidate.line)) {
                found.push(candidate);
            }
        });
        found
    }

    /// Calls `take` with the map through every two anchors and every two edges that are as far apart.
    fn propose(&self, mut take: impl FnMut(Line)) {
        let count = if self.sensors_s.len() > MANY_EDGES { ANCHORS_OF_MANY } else { ANCHORS };
        let anchors: Vec<f64> = spread(self.hosts_s.len(), count).into_iter().map(|i| self.hosts_s[i]).collect();
        let drift_max = DRIFT_MAX_PPM * 1e-6;
        for (i, &host_s) in anchors.iter().enumerate() {
            for apart_s in anchors[i + 1..].iter().map(|later_s| later_s - host_s) {
                if apart_s < self.span_s() / 4.0 {
                    continue;
                }
                let slack_s = apart_s * drift_max + self.tolerance_s;
                for (j, &sensor_s) in self.sensors_s.iter().enumerate() {
                    let later = &self.sensors_s[j + 1..];
                    let from = later.partition_point(|s| s - sensor_s < apart_s - slack_s);
                    for other_s in later[from..].iter().take_while(|s| *s - sensor_s <= apart_s + slack_s) {
                        let drift = (apart_s / (other_s - sensor_s) - 1.0).clamp(-drift_max, drift_max);
                        take(Line { offset_s: host_s - (1.0 + drift) * sensor_s, drift });
                    }
                }
            }
        }
    }

    /// Whether a map puts edges at enough of the probes; gives up early on hopeless ones.
    fn passes(&self, line: Line, probes: &[usize]) -> bool {
        let needed = (PROBES_MATCHED_MIN * probes.len() as f64).ceil() as usize;
        let mut hits = 0;
        for (tried, &probe) in probes.iter().enumerate() {
            if hits + probes.len() - tried < needed {
                return false;
            }
            hits += usize::from(self.nearest(line, self.hosts_s[probe]).is_some());
        }
        hits >= needed
    }

    /// The edge nearest to an exposure, within the tolerance.
    fn nearest(&self, line: Line, host_s: f64) -> Option<usize> {
        let sensor_s = line.sensor_s(host_s);
        let after = self.sensors_s.partition_point(|s| *s < sensor_s);
        let distance_s = |edge: usize| self.sensors_s.get(edge).map_or(f64::INFINITY, |s| (s - sensor_s).abs());
        let before = after.wrapping_sub(1);
        let edge = if distance_s(before) <= distance_s(after) { before } else { after };
        (distance_s(edge) <= self.tolerance_s).then_some(edge)
    }

    /// Maps with the same key pair the same edges.
    fn key(&self, line: Line) -> (i64, i64) {
        let at_end_s = line.sensor_s(self.span_s());
        let steps = |s: f64| (s / (self.tolerance_s / 4.0)).round() as i64;
        (steps(line.sensor_s(0.0)), steps(at_end_s))
    }

    /// Whether two fitted maps are one: an edge within the tolerance of one is within that of the other.
    fn is_same(&self, a: Line, b: Line) -> bool {
        [0.0, self.span_s()].iter().all(|&host_s| (a.sensor_s(host_s) - b.sensor_s(host_s)).abs() <= self.tolerance_s)
    }

    /// Pairs and fits in turn until both agree; `None` where too little is paired.
    fn fit(&self, mut line: Line) -> Option<Candidate> {
        for _ in 0..4 {
            line = self.least_squares(&self.candidate(line)?);
        }
        self.candidate(line)
    }

    fn candidate(&self, line: Line) -> Option<Candidate> {
        let pairs: Vec<Option<usize>> = self.hosts_s.iter().map(|&host_s| self.nearest(line, host_s)).collect();
        let residual = |(&host_s, pair): (&f64, &Option<usize>)| Some(line.residual_s(host_s, self.sensors_s[(*pair)?]));
        let residuals_s: Vec<f64> = self.hosts_s.iter().zip(&pairs).filter_map(residual).collect();
        let mut sizes: Vec<f64> = residuals_s.iter().map(|r| r.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let sigma_s = (1.4826 * sizes.get(sizes.len() / 2)?).max(SIGMA_MIN_S);
                let closed = self.last_hosts_s.iter().filter(|host_s| self.is_closed(line, **host_s)).count();
        (sizes.len() >= PAIRS_MIN).then_some(Candidate { line, pairs, residuals_s, sigma_s, closed })
    }

    /// Whether a closing pulse follows a last exposure.
    fn is_closed(&self, line: Line, host_s: f64) -> bool {
        let [from_s, to_s] = self.closing_after_s.map(|after_s| line.sensor_s(host_s + after_s));
        let next = self.closing_s.partition_point(|s| *s < from_s);
        self.closing_s.get(next).is_some_and(|s| *s <= to_s)
    }

    /// The least-squares line through the pairs that are no outliers, with drift in its bounds.
    fn least_squares(&self, candidate: &Candidate) -> Line {
        let points = self.hosts_s.iter().zip(&candidate.pairs).filter_map(|(&host_s, pair)| Some((host_s, (*pair)?)));
        let points: Vec<(f64, f64)> = points
            .map(|(host_s, edge)| (self.sensors_s[edge], host_s - self.sensors_s[edge]))
            .zip(&candidate.residuals_s)
            .filter(|(_, residual_s)| residual_s.abs() <= candidate.outlier_s())
            .map(|(point, _)| point)
            .collect();
        let count = points.len() as f64;
        let mean_s = points.iter().map(|(sensor_s, _)| sensor_s).sum::<f64>() / count;
        let mean_ahead_s = points.iter().map(|(_, ahead_s)| ahead_s).sum::<f64>() / count;
        let (mut square, mut product) = ((candidate.sigma_s / DRIFT_EXPECTED).powi(2), 0.0);
        for (sensor_s, ahead_s) in &points {
            square += (sensor_s - mean_s).powi(2);
            product += (sensor_s - mean_s) * (ahead_s - mean_ahead_s);
        }
        let drift = (product / square).clamp(-DRIFT_MAX_PPM * 1e-6, DRIFT_MAX_PPM * 1e-6);
        Line { offset_s: mean_ahead_s - drift * mean_s, drift }
    }

    /// The candidate that beats all others.
    fn choose<'a>(&self, candidates: &'a [Candidate]) -> Result<Option<&'a Candidate>, SyncError> {
        let Some(first) = candidates.first() else { return Ok(None) };
        let best = candidates.iter().fold(first, |best, other| if self.beats(other, best) { other } else { best });
        match candidates.iter().find(|other| !std::ptr::eq(*other, best) && !self.beats(best, other)) {
            None => Ok(Some(best)),
            Some(other) => Err(SyncError::Ambiguous {
                offset_s: self.clock(best.line).offset_s,
                matched: best.matched(),
                other_offset_s: self.clock(other.line).offset_s,
                other_matched: other.matched(),
            }),
        }
    }

    /// Whether `a` is clearly the better answer: it fits far better and explains about as much, or else explains more.
    fn beats(&self, a: &Candidate, b: &Candidate) -> bool {
        let about = (self.hosts_s.len() / 10).max(2);
        if b.is_quieter_than(a) && b.explained() + about >= a.explained() {
            return false;
        }
        a.is_quieter_than(b) && a.explained() + about >= b.explained() || a.explained() > b.explained()
    }
}

/// Up to `count` indices below `len`, evenly spread, ends included.
fn spread(len: usize, count: usize) -> Vec<usize> {
    if len <= count {
        return (0..len).collect();
    }
    (0..count).map(|k| k * (len - 1) / (count - 1)).collect()
}
