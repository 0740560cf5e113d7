//! Which events of a recording belong to which exposure: by trigger edges, by the arrival of packets, or by the period
//! of the captures alone.

use super::pixels::{Part, Seen, SeenTiming, Shot};
use super::setup::Setup;
use crate::calibration::result::PairedBy;
use crate::devices::PRE_ROLL_S;
use crate::events::sync::{Arrival, ExposureTime, HostClock, SyncSettings, TriggerSync, Window};
use crate::events::{Decoder, Event, Format, Sink, Trigger};
use crate::recording::{Entry, EventPacket};
use crate::session::{Command, Input, Outcome};

/// The event windows that observe a pose, in order of time; empty with a problem noted where none can be found.
pub(super) fn event_windows(
    part: &Part<'_>,
    setup: &Setup,
    shots: &[Shot<'_>],
    outcome: &Outcome,
    seen: &mut Seen,
) -> Vec<(usize, Window)> {
    let heard = match Heard::of(part, setup) {
        Ok(heard) => heard,
        Err(why) => {
            seen.problems.push(format!("event camera: {why}"));
            return Vec::new();
        }
    };
    let found = match (shots.is_empty(), setup.wired) {
        (true, _) => Ok(heard.without_exposures(part, setup, outcome, seen)),
        (false, true) => heard.by_triggers(setup, shots, seen),
        (false, false) => heard.by_arrivals(setup, shots, seen),
    };
    let mut windows = found.unwrap_or_else(|why| {
        seen.problems.push(format!("event camera: {why}"));
        Vec::new()
    });
    windows.sort_by_key(|(_, window)| window.start_us);
    windows
}

/// Edges and packets of a part.
#[derive(Default)]
struct Heard {
    /// Rising and falling edges, capture by capture.
    edges: Vec<Vec<Trigger>>,
    /// Edges outside captures.
    other_edges: Vec<Trigger>,
    /// First and last sensor time of each capture, microseconds.
    spans_us: Vec<Option<[i64; 2]>>,
    arrivals: Vec<Arrival>,
    /// Whether the stamps of packets are those of their arrival.
    arrived: bool,
}

impl Heard {
    fn of(part: &Part<'_>, setup: &Setup) -> Result<Self, String> {
        let (mut sink, mut heard) = (Edges::default(), Self { arrived: setup.arrivals, ..Self::default() });
        decode(part, &mut sink, &mut |sink, mark| match mark {
            Mark::Packet { stamp_ns } => {
                let arrival = |last_us| Arrival { last_us, host_s: stamp_ns as f64 * 1e-9 };
                heard.arrivals.extend(sink.last_us.take().map(arrival));
            }
            Mark::Begun => {
                // Events from long before a capture are there only where everything is recorded.
                let from_us = sink.span_us.map_or(0, |[_, last_us]| last_us - (PRE_ROLL_S * 1e6) as i64);
                sink.edges.retain(|edge| edge.t_us >= from_us);
                sink.span_us = sink.span_us.map(|[first_us, last_us]| [first_us.max(from_us), last_us]);
            }
            Mark::Capture => {
                heard.edges.push(std::mem::take(&mut sink.edges));
                heard.spans_us.push(sink.span_us.take());
            }
            Mark::Watched => {
                heard.other_edges.append(&mut sink.edges);
                sink.span_us = None;
            }
        })?;
        heard.other_edges.append(&mut sink.edges);
        Ok(heard)
    }

    fn host_clock(&self) -> Option<HostClock> {
        HostClock::find(&self.arrivals).filter(|_| self.arrived)
    }

    fn by_triggers(&self, setup: &Setup, shots: &[Shot<'_>], seen: &mut Seen) -> Result<Vec<(usize, Window)>, String> {
        // Poses are counted from 1 in what people read.
        let exposure = |s: &Shot<'_>| ExposureTime {
            pose: s.taken_at + 1,
            start_host_s: s.exposure.start_s,
            end_host_s: s.exposure.end_s,
            closing: s.exposure.closing,
        };
        let exposures: Vec<_> = shots.iter().map(exposure).collect();
        let settings = SyncSettings {
            channel: setup.trigger_channel,
            exposure_s: setup.exposure_s,
            frame_period_s: setup.image_period_s,
            arrivals: self.host_clock(),
        };
        let edges: Vec<Trigger> = self.edges.iter().flatten().chain(&self.other_edges).copied().collect();
        let sync = TriggerSync::find(&edges, &exposures, &settings).map_err(|why| why.to_string())?;
        let middle_us = edges.get(edges.len() / 2).map_or(0, |edge| edge.t_us);
        let later_s = |heard: HostClock| {
            heard.clock.host_s_from_sensor_us(middle_us) - sync.clock.host_s_from_sensor_us(middle_us)
        };
        seen.add_timing(SeenTiming {
            paired_by: PairedBy::Trigger,
            offset_s: sync.clock.offset_s,
            drift_ppm: sync.clock.ppm,
            residual_rms_s: sync.residual_rms_s,
            arrival_latency_s: settings.arrivals.map(later_s),
            windows: [sync.matched, exposures.len()],
            notes: sync.notes,
        });
        let observed = shots.iter().zip(&sync.windows);
        Ok(observed.filter_map(|(shot, window)| Some((shot.pose?, (*window)?))).collect())
    }

    /// Without the wire: the arm stands still, so events of about the right time are of the right pose.
    fn by_arrivals(&self, setup: &Setup, shots: &[Shot<'_>], seen: &mut Seen) -> Result<Vec<(usize, Window)>, String> {
        let heard = self.host_clock().ok_or(
            "exposures are not wired to the event camera (`wired: false`), and too few packets have a time of \
             arrival to pair by: wire them, or record for longer",
        )?;
        let window = |shot: &Shot<'_>| {
            let [start_us, end_us] = [shot.exposure.start_s, shot.exposure.start_s + setup.image_period_s]
                .map(|host_s| heard.clock.sensor_us_from_host_s(host_s));
            Some((shot.pose?, Window { start_us, end_us, assumed_end: true }))
        };
        let windows: Vec<_> = shots.iter().filter_map(window).collect();
        let note = format!(
            "no trigger wire: images and events are paired by the arrival of {} packets, which puts events too late by \
             the latency of the fastest one (others take {:.1} ms more, median)",
            self.arrivals.len(),
            heard.latency_spread_s * 1e3
        );
        seen.add_timing(SeenTiming {
            paired_by: PairedBy::Arrival,
            offset_s: heard.clock.offset_s,
            drift_ppm: heard.clock.ppm,
            residual_rms_s: heard.latency_spread_s,
            arrival_latency_s: None,
            windows: [windows.len(), shots.len()],
            notes: vec![note],
        });
        Ok(windows)
    }

    /// A session without a frame camera has no exposures: each rising edge of a capture begins a window that the
    /// next one ends; without edges the still part of a capture is cut into windows of one image period.
    fn without_exposures(
        &self,
        part: &Part<'_>,
        setup: &Setup,
        outcome: &Outcome,
        seen: &mut Seen,
    ) -> Vec<(usize, Window)> {
        let heard = self.host_clock();
        let (mut windows, mut unpaced) = (Vec::new(), 0);
        for (pose, record) in outcome.poses.iter().enumerate() {
            let Some(capture) = record.capture.and_then(|c| c.checked_sub(part.captures_before)) else { continue };
            let Some(edges) = self.edges.get(capture) else { continue };
            let is_start = |t: &&Trigger| t.rising && t.channel == setup.trigger_channel;
            let rising: Vec<i64> = edges.iter().filter(is_start).map(|t| t.t_us).collect();
            let still = record.evidence.as_ref().zip(heard);
            let still_us = still.map(|(e, heard)| [e.from_s, e.to_s].map(|s| heard.clock.sensor_us_from_host_s(s)));
            let is_still = |w: &Window| still_us.is_none_or(|[from, to]| w.start_us >= from && w.end_us <= to);
            let by_edges = rising.windows(2).map(|w| Window { start_us: w[0], end_us: w[1], assumed_end: false });
            if rising.len() >= 2 {
                windows.extend(by_edges.filter(is_still).map(|window| (pose, window)));
                continue;
            }
            unpaced += 1;
            let span_us = self.spans_us.get(capture).copied().flatten();
            windows.extend(tiles(span_us, still_us, setup.image_period_s).map(|window| (pose, window)));
        }
        if unpaced > 0 {
            let note = format!("{unpaced} poses have no trigger edges: their events are cut by the image period alone");
            let (offset_s, drift_ppm) = heard.map_or((0.0, 0.0), |h| (h.clock.offset_s, h.clock.ppm));
            seen.add_timing(SeenTiming {
                paired_by: PairedBy::Period,
                offset_s,
                drift_ppm,
                residual_rms_s: heard.map_or(0.0, |h| h.latency_spread_s),
                arrival_latency_s: None,
                windows: [windows.len(), windows.len()],
                notes: vec![note],
            });
        }
        windows
    }
}

/// Windows of one period, end to end, in what was recorded while the arm stood still.
fn tiles(span_us: Option<[i64; 2]>, still_us: Option<[i64; 2]>, period_s: f64) -> impl Iterator<Item = Window> {
    let period_us = ((period_s * 1e6).round() as i64).max(1);
    let [mut from_us, mut to_us] = span_us.unwrap_or([0, 0]);
    if let Some([still_from_us, still_to_us]) = still_us {
        (from_us, to_us) = (from_us.max(still_from_us), to_us.min(still_to_us));
    }
    let count = (to_us.saturating_sub(from_us) / period_us).max(0);
    let start_us = move |i: i64| from_us.saturating_add(i.saturating_mul(period_us));
    (0..count).map(move |i| Window { start_us: start_us(i), end_us: start_us(i + 1), assumed_end: true })
}

#[derive(Default)]
struct Edges {
    edges: Vec<Trigger>,
    /// Of the packet that is decoded.
    last_us: Option<i64>,
    /// Of the capture that is decoded.
    span_us: Option<[i64; 2]>,
}

impl Edges {
    fn at(&mut self, t_us: i64) {
        self.last_us = self.last_us.max(Some(t_us));
        let [first_us, last_us] = self.span_us.unwrap_or([t_us, t_us]);
        self.span_us = Some([first_us.min(t_us), last_us.max(t_us)]);
    }
}

impl Sink for Edges {
    fn event(&mut self, event: Event) {
        self.at(event.t_us);
    }

    fn trigger(&mut self, trigger: Trigger) {
        self.at(trigger.t_us);
        self.edges.push(trigger);
    }
}

/// What [`decode`] passes.
pub(super) enum Mark {
    /// The begin of a capture of a live session.
    Begun,
    /// The end of a packet.
    Packet {
        /// Its stamp: the time of its arrival where the session is live.
        stamp_ns: u64,
    },
    /// The end of a capture.
    Capture,
    /// The end of watching the display.
    Watched,
}

/// Runs every event packet of a part through a decoder.
///
/// Packets of one capture follow each other without a gap, unless one is missing in the recording; between captures the
/// camera was not recorded.
pub(super) fn decode<S: Sink>(
    part: &Part<'_>,
    sink: &mut S,
    passed: &mut dyn FnMut(&mut S, Mark),
) -> Result<(), String> {
    let mut decoder: Option<Decoder> = None;
    // A live session joins the stream at its first capture; an import begins with the stream itself.
    let mut gap = part.joins;
    let mut expected: Option<u64> = None;
    for entry in part.entries {
        match entry {
            Entry::Events(EventPacket { encoding, time_base_ns, events, stamp_ns, sequence, .. }) => {
                gap |= expected.is_some_and(|expected| expected != *sequence);
                expected = Some(sequence.wrapping_add(1));
                let decoder = match &mut decoder {
                    Some(decoder) => decoder,
                    none => none.insert(Decoder::new(Format::from_name(encoding).map_err(|e| e.to_string())?)),
                };
                if gap {
                    decoder.set_epoch_us((time_base_ns / 1000) as i64);
                    gap = false;
                }
                decoder.decode_into(events, sink);
                passed(sink, Mark::Packet { stamp_ns: *stamp_ns });
            }
            Entry::Input(_, Input::Captured(_)) => {
                gap = decoder.is_some();
                passed(sink, Mark::Capture);
            }
            Entry::Input(_, Input::Watched(_)) => {
                gap = true;
                passed(sink, Mark::Watched);
            }
            Entry::Command(Command::Capture { .. }) if part.joins => passed(sink, Mark::Begun),
            Entry::Input(..) | Entry::Command(_) | Entry::Image(..) => {}
        }
    }
    Ok(())
}
