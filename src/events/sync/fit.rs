//! Pairs of times on two clocks, and the line through them.

use super::{DRIFT_MAX_PPM, PAIRS_MIN, TOLERANCE_PERIODS};

/// Standard deviations from the fit at which a pair leaves it.
const OUTLIER_SIGMAS: f64 = 6.0;
/// Noise below this is not told apart: times are whole microseconds.
const SIGMA_MIN_S: f64 = 5e-6;
/// How much the drift is expected to be, before the data are seen; matters in sessions of seconds only.
const DRIFT_EXPECTED: f64 = 100e-6;

/// `host = offset + (1 + drift) * sensor`, both in the seconds of [`Times`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub(super) offset_s: f64,
    pub(super) drift: f64,
}

impl Line {
    pub(super) fn sensor_s(self, host_s: f64) -> f64 {
        (host_s - self.offset_s) / (1.0 + self.drift)
    }

    fn residual_s(self, host_s: f64, sensor_s: f64) -> f64 {
        host_s - self.offset_s - (1.0 + self.drift) * sensor_s
    }
}

/// Starts of exposures and rising edges, each rising and in seconds since a reference on its own clock, so that no
/// precision is lost to large offsets.
#[derive(Debug)]
pub(super) struct Times {
    pub(super) hosts_s: Vec<f64>,
    pub(super) sensors_s: Vec<f64>,
    /// How far apart a pair may be.
    pub(super) tolerance_s: f64,
}

impl Times {
    pub(super) fn new(hosts_s: Vec<f64>, sensors_s: Vec<f64>, period_s: f64) -> Self {
        Self { hosts_s, sensors_s, tolerance_s: period_s * TOLERANCE_PERIODS }
    }

    /// From the first exposure to the last.
    pub(super) fn span_s(&self) -> f64 {
        self.hosts_s.last().copied().unwrap_or(0.0)
    }

    /// The edge nearest to an exposure, within the tolerance.
    pub(super) fn nearest(&self, line: Line, host_s: f64) -> Option<usize> {
        let sensor_s = line.sensor_s(host_s);
        self.nearer(sensor_s, self.sensors_s.partition_point(|s| *s < sensor_s))
    }

    /// The nearer of the edge `after` a time and the one before it, within the tolerance.
    fn nearer(&self, sensor_s: f64, after: usize) -> Option<usize> {
        let distance_s = |edge: usize| self.sensors_s.get(edge).map_or(f64::INFINITY, |s| (s - sensor_s).abs());
        let before = after.wrapping_sub(1);
        let edge = if distance_s(before) <= distance_s(after) { before } else { after };
        (distance_s(edge) <= self.tolerance_s).then_some(edge)
    }

    /// Lines with the same key pair the same edges.
    pub(super) fn key(&self, line: Line) -> (i64, i64) {
        let steps = |s: f64| (s / (self.tolerance_s / 4.0)).round() as i64;
        (steps(line.sensor_s(0.0)), steps(line.sensor_s(self.span_s())))
    }

    /// Whether two fitted lines are one: an edge within the tolerance of one is within that of the other.
    pub(super) fn is_same(&self, a: Line, b: Line) -> bool {
        [0.0, self.span_s()].iter().all(|&host_s| (a.sensor_s(host_s) - b.sensor_s(host_s)).abs() <= self.tolerance_s)
    }
}

/// Which edges a line puts at which exposures.
#[derive(Debug)]
pub(super) struct Pairing {
    /// Indices of exposure and edge; at least [`PAIRS_MIN`].
    pub(super) pairs: Vec<(usize, usize)>,
    /// Host time minus mapped sensor time of each pair.
    pub(super) residuals_s: Vec<f64>,
    /// Noise, from the median of the residuals.
    pub(super) sigma_s: f64,
}

impl Pairing {
    /// `None` for too few pairs.
    pub(super) fn new(line: Line, times: &Times) -> Option<Self> {
        let (mut pairs, mut residuals_s, mut after) = (Vec::new(), Vec::new(), 0);
        for (exposure, &host_s) in times.hosts_s.iter().enumerate() {
            let sensor_s = line.sensor_s(host_s);
            while times.sensors_s.get(after).is_some_and(|s| *s < sensor_s) {
                after += 1;
            }
            if let Some(edge) = times.nearer(sensor_s, after) {
                pairs.push((exposure, edge));
                residuals_s.push(line.residual_s(host_s, times.sensors_s[edge]));
            }
        }
        if pairs.len() < PAIRS_MIN {
            return None;
        }
        let mut sizes: Vec<f64> = residuals_s.iter().map(|r| r.abs()).collect();
        let (_, median_s, _) = sizes.select_nth_unstable_by(pairs.len() / 2, f64::total_cmp);
        let sigma_s = (1.4826 * *median_s).max(SIGMA_MIN_S);
        Some(Self { pairs, residuals_s, sigma_s })
    }

    /// Residuals beyond this do not enter the fit.
    pub(super) fn outlier_s(&self) -> f64 {
        OUTLIER_SIGMAS * self.sigma_s
    }

    /// Root mean square of the residuals that are wanted.
    pub(super) fn rms_s(&self, wanted: impl Fn(f64) -> bool) -> f64 {
        let squares: Vec<f64> = self.residuals_s.iter().filter(|r| wanted(**r)).map(|r| r * r).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    /// The least-squares line through the pairs that are no outliers, with drift in its bounds.
    pub(super) fn least_squares(&self, times: &Times) -> Line {
        let inliers = self.pairs.iter().zip(&self.residuals_s).filter(|(_, r)| r.abs() <= self.outlier_s());
        let points: Vec<(f64, f64)> = inliers
            .map(|(&(exposure, edge), _)| (times.sensors_s[edge], times.hosts_s[exposure] - times.sensors_s[edge]))
            .collect();
        let count = points.len() as f64;
        let mean_s = points.iter().map(|(sensor_s, _)| sensor_s).sum::<f64>() / count;
        let mean_ahead_s = points.iter().map(|(_, ahead_s)| ahead_s).sum::<f64>() / count;
        let (mut square, mut product) = ((self.sigma_s / DRIFT_EXPECTED).powi(2), 0.0);
        for (sensor_s, ahead_s) in &points {
            square += (sensor_s - mean_s).powi(2);
            product += (sensor_s - mean_s) * (ahead_s - mean_ahead_s);
        }
        let drift = (product / square).clamp(-DRIFT_MAX_PPM * 1e-6, DRIFT_MAX_PPM * 1e-6);
        Line { offset_s: mean_ahead_s - drift * mean_s, drift }
    }
}
