//! From edges to pulses: which rising edges start an exposure, which close the last window of a pose.

use super::{DOUBLED_MAX_US, SyncSettings};
use crate::events::Trigger;

/// A rising edge that is not a bounce.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Edge {
    /// Microseconds of the sensor's clock.
    pub(super) t_us: i64,
    /// Whether it begins a closing pulse.
    pub(super) closing: bool,
}

/// The rising edges of one channel, in order of time.
#[derive(Debug, Clone)]
pub(super) struct Edges {
    pub(super) rising: Vec<Edge>,
    /// Bounces that were dropped.
    pub(super) doubled: usize,
}

/// A rising edge and the falling edge that ends it.
struct Pulse {
    rise_us: i64,
    fall_us: Option<i64>,
    /// Whether the signal rose again after `fall_us`.
    bounced: bool,
}

impl Edges {
    pub(super) fn classify(triggers: &[Trigger], settings: &SyncSettings) -> Self {
        let mut edges: Vec<&Trigger> = triggers.iter().filter(|edge| edge.channel == settings.channel).collect();
        edges.sort_by_key(|edge| edge.t_us);
        let (pulses, doubled) = pulses(&edges);
        let closing_max_us = settings.exposure_s * 0.5e6;
        let closing = |pulse: &Pulse| {
            pulse.fall_us.is_some_and(|t_us| (t_us.saturating_sub(pulse.rise_us) as f64) < closing_max_us)
        };
        let rising = pulses.iter().map(|pulse| Edge { t_us: pulse.rise_us, closing: closing(pulse) }).collect();
        Self { rising, doubled }
    }

    /// Indices of the edges that can start an exposure.
    pub(super) fn starts(&self) -> Vec<usize> {
        (0..self.rising.len()).filter(|&edge| !self.rising[edge].closing).collect()
    }

    /// How many closing pulses there are.
    pub(super) fn closing(&self) -> usize {
        self.rising.iter().filter(|edge| edge.closing).count()
    }
}

/// Pulses, and how many rising edges were bounces of the one before.
fn pulses(edges: &[&Trigger]) -> (Vec<Pulse>, usize) {
    let mut pulses: Vec<Pulse> = Vec::new();
    let mut doubled = 0;
    for edge in edges {
        match (edge.rising, pulses.last_mut()) {
            (true, Some(last)) if edge.t_us.saturating_sub(last.rise_us) <= DOUBLED_MAX_US => {
                doubled += 1;
                last.bounced = true;
            }
            (true, _) => pulses.push(Pulse { rise_us: edge.t_us, fall_us: None, bounced: false }),
            (false, Some(last)) if last.fall_us.is_none() || last.bounced => {
                last.fall_us = Some(edge.t_us);
                last.bounced = false;
            }
            (false, _) => (),
        }
    }
    (pulses, doubled)
}
