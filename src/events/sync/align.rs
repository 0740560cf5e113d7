//! Finds which edge starts which exposure, from times on two clocks that differ by an offset and a drift.
//!
//! Every two exposures far apart and every two edges about as far apart propose a map; a map that puts an edge at many
//! exposures is fitted by robust least squares. The best one must beat every other one, or nothing is returned.
//! Closing pulses are too loosely timed for the fit, but where one belongs after each pose they are evidence too.

use std::collections::HashSet;

use super::edges::Edges;
use super::fit::{Line, Pairing, Times};
use super::windows::{EXPOSURE_PART_MIN, PERIODS_MAX};
use super::{ClockMap, ExposureTime, HostClock, SyncError, SyncSettings};
use super::{DRIFT_MAX_PPM, PAIRS_MIN, RESIDUAL_PERIODS};

/// Exposures whose pairs propose maps; fewer for long sessions, where the work grows with the number of edges.
const ANCHORS: usize = 12;
const ANCHORS_OF_MANY: usize = 6;
const MANY_EDGES: usize = 3000;
/// Exposures on which a map is tried before all are, and the part of them that must have an edge.
const PROBES: usize = 32;
const PROBES_MATCHED_MIN: f64 = 0.35;
/// Part of the exposures that must have an edge.
const MATCHED_MIN: f64 = 0.5;
/// A true map is earlier than the arrivals by the latency of the fastest packet, up to this part of the shortest
/// exposure spacing; the rest of one spacing is for errors of the host's stamps.
const EARLY_PERIODS: f64 = 0.75;
/// Fits that are made of one map, to let the pairs settle.
const FITS: usize = 4;

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
    let Some(best) = problem.choose_in_time(&candidates, settings.arrivals)? else { return Ok(None) };
    let Some(pairing) = Pairing::new(best.line, &problem.times) else { return Ok(None) };
    let limit_s = problem.period_s * RESIDUAL_PERIODS;
    let residual_rms_s = pairing.rms_s(|_| true);
    let quiet = residual_rms_s <= limit_s;
    if !quiet {
        return Err(SyncError::Residual { residual_rms_s, limit_s });
    }
    let mut pairs = vec![None; exposures.len()];
    for &(exposure, start) in &pairing.pairs {
        pairs[order[exposure]] = Some(starts[start]);
    }
    let outlier_s = pairing.outlier_s();
    let outliers = pairing.residuals_s.iter().filter(|r| r.abs() > outlier_s).count();
    let rms_s = pairing.rms_s(|r| r.abs() <= outlier_s);
    Ok(Some(Aligned { clock: problem.clock(best.line), pairs, rms_s, outliers }))
}

/// A fitted map, and how much it explains.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    line: Line,
    /// Exposures with an edge.
    matched: usize,
    /// Poses with a closing pulse after their last exposure.
    closed: usize,
    /// Noise of the pairs.
    sigma_s: f64,
}

impl Candidate {
    /// Pulses that are where they belong.
    fn explained(&self) -> usize {
        self.matched + self.closed
    }

    /// Whether it fits so much better than `other` that chance cannot be the reason.
    ///
    /// The bound on the ratio of variances is about the 99.9 % point of the F distribution, widened because medians
    /// are rough.
    fn is_quieter_than(&self, other: &Self) -> bool {
        let freedom = self.matched.min(other.matched).saturating_sub(2).max(1) as f64;
        (other.sigma_s / self.sigma_s).powi(2) > 1.0 + 40.0 / freedom.sqrt()
    }
}

/// What is to be paired.
struct Problem {
    times: Times,
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
            times: Times::new(hosts_s, starts.iter().map(|&index| sensor_s(index)).collect(), period_s),
            last_hosts_s: poses.filter_map(|pose| pose.last()).map(host_s).collect(),
            closing_s: (0..edges.rising.len()).filter(|&i| edges.rising[i].closing).map(sensor_s).collect(),
            closing_after_s: [EXPOSURE_PART_MIN * settings.exposure_s, PERIODS_MAX * settings.frame_period_s],
            host_reference_s,
            sensor_reference_s: reference_us as f64 * 1e-6,
            period_s,
        })
    }

    fn clock(&self, line: Line) -> ClockMap {
        let offset_s = self.host_reference_s + line.offset_s - (1.0 + line.drift) * self.sensor_reference_s;
        ClockMap { offset_s, ppm: line.drift * 1e6 }
    }

    /// All fitted maps that pair enough and are not far behind the best, each once.
    fn candidates(&self) -> Vec<Candidate> {
        let (mut found, mut tried, mut most) = (Vec::<Candidate>::new(), HashSet::new(), 0);
        let probes = spread(self.times.hosts_s.len(), PROBES);
        let needed = (MATCHED_MIN * self.times.hosts_s.len() as f64).ceil().max(PAIRS_MIN as f64) as usize;
        self.propose(|line| {
            if !self.passes(line, &probes) || !tried.insert(self.times.key(line)) {
                return;
            }
            let Some(candidate) = self.fit(line, most) else { return };
            most = most.max(candidate.explained());
            if candidate.matched >= needed && !found.iter().any(|other| self.times.is_same(other.line, candidate.line))
            {
                found.push(candidate);
            }
        });
        found
    }

    /// Calls `take` with the map through every two anchors and every two edges that are as far apart.
    fn propose(&self, mut take: impl FnMut(Line)) {
        let count = if self.times.sensors_s.len() > MANY_EDGES { ANCHORS_OF_MANY } else { ANCHORS };
        let anchors: Vec<f64> =
            spread(self.times.hosts_s.len(), count).into_iter().map(|i| self.times.hosts_s[i]).collect();
        let drift_max = DRIFT_MAX_PPM * 1e-6;
        for (i, &host_s) in anchors.iter().enumerate() {
            for apart_s in anchors[i + 1..].iter().map(|later_s| later_s - host_s) {
                if apart_s < self.times.span_s() / 4.0 {
                    continue;
                }
                let slack_s = apart_s * drift_max + self.times.tolerance_s;
                for (j, &sensor_s) in self.times.sensors_s.iter().enumerate() {
                    let later = &self.times.sensors_s[j + 1..];
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
            hits += usize::from(self.times.nearest(line, self.times.hosts_s[probe]).is_some());
        }
        hits >= needed
    }

    /// Pairs and fits in turn; `None` where too little is paired or far less than the `most` explained so far.
    fn fit(&self, mut line: Line, most: usize) -> Option<Candidate> {
        for _ in 0..FITS {
            let pairing = Pairing::new(line, &self.times)?;
            if self.candidate(line, &pairing).explained() + 2 * self.about() < most {
                return None;
            }
            line = pairing.least_squares(&self.times);
        }
        Some(self.candidate(line, &Pairing::new(line, &self.times)?))
    }

    fn candidate(&self, line: Line, pairing: &Pairing) -> Candidate {
        let closed = self.last_hosts_s.iter().filter(|host_s| self.is_closed(line, **host_s)).count();
        Candidate { line, matched: pairing.pairs.len(), closed, sigma_s: pairing.sigma_s }
    }

    /// Whether a closing pulse follows a last exposure.
    fn is_closed(&self, line: Line, host_s: f64) -> bool {
        let [from_s, to_s] = self.closing_after_s.map(|after_s| line.sensor_s(host_s + after_s));
        let next = self.closing_s.partition_point(|s| *s < from_s);
        self.closing_s.get(next).is_some_and(|s| *s <= to_s)
    }

    /// The candidate that beats all others among those that agree with the arrival of the packets.
    fn choose_in_time(
        &self,
        candidates: &[Candidate],
        arrivals: Option<HostClock>,
    ) -> Result<Option<Candidate>, SyncError> {
        let Some(arrivals) = arrivals else { return self.choose(candidates) };
        let by_s = |candidate: &Candidate| self.after_arrivals_s(candidate, &arrivals);
        let in_time = |candidate: &&Candidate| {
            let periods = by_s(candidate) / self.period_s;
            (-EARLY_PERIODS..=1.0 - EARLY_PERIODS).contains(&periods)
        };
        let near: Vec<Candidate> = candidates.iter().filter(in_time).copied().collect();
        let most = candidates.iter().max_by_key(|candidate| candidate.explained());
        let explained = near.iter().map(Candidate::explained).max().unwrap_or(0);
        match most {
            Some(most) if most.explained() > explained + self.about() => {
                let by_s = by_s(most);
                let periods = by_s / self.period_s;
                Err(SyncError::Shifted { by_s, images: (periods.abs().ceil() * periods.signum()) as i64 })
            }
            Some(_) | None => self.choose(&near),
        }
    }

    /// How much later than by the arrivals a candidate puts the middle of the edges, seconds; true maps are earlier,
    /// by the smallest latency of a packet.
    fn after_arrivals_s(&self, candidate: &Candidate, arrivals: &HostClock) -> f64 {
        let [first_s, last_s] = [self.times.sensors_s.first(), self.times.sensors_s.last()].map(|s| *s.unwrap_or(&0.0));
        let middle_us = ((0.5 * (first_s + last_s) + self.sensor_reference_s) * 1e6).round() as i64;
        let ours_s = self.clock(candidate.line).host_s_from_sensor_us(middle_us);
        ours_s - arrivals.clock.host_s_from_sensor_us(middle_us)
    }

    /// The candidate that beats all others.
    fn choose(&self, candidates: &[Candidate]) -> Result<Option<Candidate>, SyncError> {
        let Some(first) = candidates.first() else { return Ok(None) };
        let best = candidates.iter().fold(first, |best, other| if self.beats(other, best) { other } else { best });
        match candidates.iter().find(|other| !std::ptr::eq(*other, best) && !self.beats(best, other)) {
            None => Ok(Some(*best)),
            Some(other) => Err(SyncError::Ambiguous {
                offset_s: self.clock(best.line).offset_s,
                matched: best.matched,
                other_offset_s: self.clock(other.line).offset_s,
                other_matched: other.matched,
            }),
        }
    }

    /// Two maps explain about as much if they differ by fewer pulses.
    fn about(&self) -> usize {
        (self.times.hosts_s.len() / 10).max(2)
    }

    /// Whether `a` is clearly the better answer: it fits far better and explains about as much, or else explains more.
    fn beats(&self, a: &Candidate, b: &Candidate) -> bool {
        let about = self.about();
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
