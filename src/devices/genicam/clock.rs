//! When an exposure began, on the session's clock.
//!
//! A camera stamps its images on a clock of its own, whose zero is anywhere and which runs some ppm fast or slow.
//! Images arrive late by an amount that varies, but never early: the smallest difference of arrival and stamp that
//! was seen is the best estimate of the offset. It rises at [`DRIFT_MAX_PPM`] until an image pulls it down again,
//! which follows the drift over a session of any length. An image cannot arrive before its exposure has ended, so
//! the exposure is taken to begin one exposure time before: that holds whether the camera stamps the begin or the
//! end. What remains is the least time from the end of the exposure to the first packet, the same for all images.

/// Largest difference of two clocks that is followed, ppm.
const DRIFT_MAX_PPM: f64 = 200.0;
/// An image that seems this late means that the camera's clock was set anew, s.
const JUMP_S: f64 = 1.0;

/// From the camera's clock to the session's, image by image.
#[derive(Debug, Default)]
pub(super) struct CameraClock {
    /// The first stamp, ns: differences to it are exact as seconds.
    first_ns: Option<u64>,
    /// At which camera time the offset was, s.
    last: Option<(f64, f64)>,
}

impl CameraClock {
    /// Session time of the end of an exposure, s; images in the order in which they arrived.
    ///
    /// `arrived_s` is when its first packet did. Without a stamp (0) that is all there is.
    pub(super) fn end_s(&mut self, stamp_ns: u64, arrived_s: f64) -> f64 {
        if stamp_ns == 0 {
            return arrived_s;
        }
        let first_ns = *self.first_ns.get_or_insert(stamp_ns);
        let camera_s = (i128::from(stamp_ns) - i128::from(first_ns)) as f64 * 1e-9;
        let late_s = arrived_s - camera_s;
        let offset_s = match self.last {
            None => late_s,
            Some((at_s, before_s)) => {
                let risen_s = before_s + DRIFT_MAX_PPM * 1e-6 * (camera_s - at_s).max(0.0);
                if late_s < risen_s || late_s > risen_s + JUMP_S { late_s } else { risen_s }
            }
        };
        self.last = Some((camera_s, offset_s));
        camera_s + offset_s
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    use super::*;

    /// Ten images a second for half an hour, with queueing on the way; the largest error after the first ten, s.
    fn worst_s(ppm: f64, least_s: f64) -> f64 {
        let mut random = Pcg64::seed_from_u64(7);
        let mut clock = CameraClock::default();
        let mut worst_s = 0.0_f64;
        for i in 0..18_000 {
            let true_s = 0.1 * f64::from(i);
            let stamp_ns = 7_000_000_000_000 + (true_s * 1e9 * (1.0 + ppm * 1e-6)) as u64;
            // Most packets wait for less than a millisecond, some for long.
            let wait_s =
                if random.random_bool(0.1) { random.random_range(0.0..0.08) } else { random.random_range(0.0..1e-3) };
            let found_s = clock.end_s(stamp_ns, true_s + least_s + wait_s) - least_s;
            if i >= 10 {
                worst_s = worst_s.max((found_s - true_s).abs());
            }
        }
        worst_s
    }

    #[test]
    fn offset_and_drift_are_followed_to_a_fraction_of_a_millisecond() {
        for ppm in [-100.0, -20.0, 0.0, 35.0, 100.0] {
            let worst_s = worst_s(ppm, 0.004);
            assert!(worst_s < 1.2e-3, "{ppm} ppm: {worst_s} s");
        }
    }

    #[test]
    fn clocks_that_stop_or_are_set_anew_are_followed_at_once() {
        let mut clock = CameraClock::default();
        assert_eq!(clock.end_s(1_000_000_000, 5.0), 5.0);
        // The session's clock stood still for 2 s.
        assert_eq!(clock.end_s(4_000_000_000, 6.0), 6.0);
        // The camera began to count anew.
        assert_eq!(clock.end_s(100, 7.0), 7.0);
        assert_eq!(clock.end_s(0, 8.5), 8.5, "no stamp at all");
    }
}
