//! The sensor's clock against the host's, from nothing but the arrival of packets: the trigger wire's second witness.
//!
//! A packet arrives after its last event, by a latency that varies but is never negative: the line under all arrivals
//! that lies closest to them is the map of the clocks plus the smallest latency.

use super::{ClockMap, DRIFT_MAX_PPM};

/// Fewest packets from which a map is found.
const ARRIVALS_MIN: usize = 5;

/// A packet of events that reached the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Sensor time of its last event or edge, microseconds.
    pub last_us: i64,
    /// When it arrived, seconds of the host's clock.
    pub host_s: f64,
}

/// What the arrivals say about the clocks.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct HostClock {
    /// From the sensor's clock to the host's; late by the smallest latency of a packet.
    pub clock: ClockMap,
    /// By how much a packet is later than the fastest ones, median, seconds.
    pub latency_spread_s: f64,
}

impl HostClock {
    /// Finds the map from packets in any order; `None` for fewer than five, or for times that are no numbers.
    pub fn find(arrivals: &[Arrival]) -> Option<Self> {
        let reference_us = arrivals.first()?.last_us;
        let point = |arrival: &Arrival| {
            let sensor_s = arrival.last_us.saturating_sub(reference_us) as f64 * 1e-6;
            (sensor_s, arrival.host_s - sensor_s)
        };
        let mut points: Vec<(f64, f64)> = arrivals.iter().map(point).collect();
        if points.len() < ARRIVALS_MIN || !points.iter().all(|(_, ahead_s)| ahead_s.is_finite()) {
            return None;
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mean_s = points.iter().map(|p| p.0).sum::<f64>() / points.len() as f64;
        // The edge of the hull under the mean is the line below all points with the smallest sum of distances.
        let drift = slope_under(&lower_hull(&points), mean_s).clamp(-DRIFT_MAX_PPM * 1e-6, DRIFT_MAX_PPM * 1e-6);
        let above_s = |p: &(f64, f64)| p.1 - drift * p.0;
        let lowest_s = points.iter().map(above_s).fold(f64::INFINITY, f64::min);
        let mut late_s: Vec<f64> = points.iter().map(|p| above_s(p) - lowest_s).collect();
        let (_, median_s, _) = late_s.select_nth_unstable_by(points.len() / 2, f64::total_cmp);
        let offset_s = lowest_s - (reference_us as f64 * 1e-6) * (1.0 + drift);
        Some(Self { clock: ClockMap { offset_s, ppm: drift * 1e6 }, latency_spread_s: *median_s })
    }
}

/// The points that a string pulled tight from below would touch, in order.
fn lower_hull(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut hull: Vec<(f64, f64)> = Vec::new();
    for &point in points {
        while let [.., a, b] = hull.as_slice() {
            let turns_down = (b.0 - a.0) * (point.1 - a.1) - (b.1 - a.1) * (point.0 - a.0) <= 0.0;
            if !turns_down {
                break;
            }
            hull.pop();
        }
        hull.push(point);
    }
    hull
}

fn slope_under(hull: &[(f64, f64)], at_s: f64) -> f64 {
    let edge = hull.windows(2).find(|edge| edge[1].0 >= at_s);
    let slope = edge.map(|edge| (edge[1].1 - edge[0].1) / (edge[1].0 - edge[0].0));
    slope.filter(|slope| slope.is_finite()).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use rand::{Rng as _, SeedableRng as _};
    use rand_pcg::Pcg64;

    use super::*;

    const TRUTH: ClockMap = ClockMap { offset_s: -81.25, ppm: 37.0 };

    /// Packets of 20 ms in bursts of a second every eight, each late by 2 ms and up to 6 more.
    fn arrivals(seed: u64, bursts: usize) -> Vec<Arrival> {
        let mut random = Pcg64::seed_from_u64(seed);
        let packet = |i: usize| 90_000_000 + (i / 50) as i64 * 8_000_000 + (i % 50) as i64 * 20_000;
        let arrive = |last_us: i64| {
            let latency_s = 0.002 + 0.006 * random.random::<f64>();
            Arrival { last_us, host_s: TRUTH.host_s_from_sensor_us(last_us) + latency_s }
        };
        (0..50 * bursts).map(packet).map(arrive).collect()
    }

    #[test]
    fn the_map_is_late_by_the_smallest_latency() {
        for seed in 0..20 {
            let arrivals = arrivals(seed, 40);
            let found = HostClock::find(&arrivals).unwrap();
            for at in &arrivals {
                let late_s = found.clock.host_s_from_sensor_us(at.last_us) - TRUTH.host_s_from_sensor_us(at.last_us);
                // The line rests on the fastest packets of each half: of 1000 latencies spread over 6 ms the smallest is
                // 6 us above the bound, and 100 us is beyond chance even where the line is drawn out to the ends.
                assert!((late_s - 0.002).abs() < 1e-4, "{seed}: {late_s}");
            }
            // 100 us at each end of 312 s.
            assert!((found.clock.ppm - TRUTH.ppm).abs() < 2.0 * 100.0 / 312.0, "{}", found.clock.ppm);
            assert!((found.latency_spread_s - 0.003).abs() < 0.0005, "{}", found.latency_spread_s);
        }
    }

    #[test]
    fn a_stalled_bus_only_makes_packets_late() {
        let mut stalled = arrivals(3, 40);
        for arrival in &mut stalled[700..760] {
            arrival.host_s += 0.8;
        }
        let found = HostClock::find(&stalled).unwrap();
        let at_us = stalled[720].last_us;
        let late_s = found.clock.host_s_from_sensor_us(at_us) - TRUTH.host_s_from_sensor_us(at_us);
        assert!((0.0019..0.0025).contains(&late_s), "{late_s}");
    }

    #[test]
    fn too_little_says_nothing() {
        assert_eq!(HostClock::find(&arrivals(1, 1)[..4]), None);
        assert_eq!(HostClock::find(&[]), None);
        let mut broken = arrivals(1, 1);
        broken[7].host_s = f64::NAN;
        assert_eq!(HostClock::find(&broken), None);
        // Stamps of one moment for all: finite, and no more than the bounds of drift allow.
        let same: Vec<Arrival> = (0..9).map(|_| Arrival { last_us: 5, host_s: 1.0 }).collect();
        assert!(HostClock::find(&same).unwrap().clock.offset_s.is_finite());
    }
}
