//! A double that replays recorded payloads, with everything that a bus and a person can do to it.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};

use super::*;
use crate::devices::WallClock;
use crate::events::{Encoder, Header};

/// Delivers what the test sends it.
struct Payloads(Receiver<Result<Packet, String>>);

impl PacketSource for Payloads {
    fn next(&mut self, wait: Duration) -> Result<Option<Packet>, String> {
        match self.0.recv_timeout(wait) {
            Ok(packet) => packet.map(Some),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err("unplugged".into()),
        }
    }
}

fn camera() -> (StreamedCamera, Sender<Result<Packet, String>>, Arc<dyn Clock>) {
    let clock: Arc<dyn Clock> = Arc::new(WallClock::starting_at(Stamp::from_seconds(5.0)));
    let (sender, receiver) = channel();
    let source = Box::new(Payloads(receiver));
    let facts = CameraFacts { model: "double".into(), ..CameraFacts::default() };
    let camera = StreamedCamera::start(source, facts, [1280, 720], Format::Evt3, Arc::clone(&clock)).unwrap();
    (camera, sender, clock)
}

/// Events every 10 us from `begin_ms` on for `ms` of sensor time, in packets of 1 ms, as one stream.
fn stream(begin_ms: i64, ms: i64) -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new(Format::Evt3);
    let packet = |k: i64| {
        let event = |i: i64| Event {
            t_us: (begin_ms + k) * 1000 + i * 10,
            x: (i * 7) as u16,
            y: 300 + (i % 50) as u16,
            on: i % 2 == 0,
        };
        let events: Vec<Event> = (0..100).map(event).collect();
        let mut words = Vec::new();
        encoder.encode(&events, &[], &mut words).unwrap();
        words
    };
    (0..ms).map(packet).collect()
}

fn packet(words: Vec<u8>, arrived_s: f64) -> Result<Packet, String> {
    Ok(Packet { words, arrived: Stamp::from_seconds(arrived_s), after_loss: false })
}

fn times_us(packets: &[RawEvents]) -> Vec<i64> {
    let (mut decoder, mut events, mut triggers) = (Decoder::new(Format::Evt3), Vec::new(), Vec::new());
    decoder.set_epoch_us(packets[0].first_us);
    packets.iter().for_each(|packet| decoder.decode(&packet.words, &mut events, &mut triggers));
    events.iter().map(|event| event.t_us).collect()
}

/// Waits until the reader has taken all that was sent.
fn taken(camera: &StreamedCamera, last_s: f64) {
    let (lock, came) = &*camera.shared;
    let shared = lock.lock().unwrap();
    let waiting = |shared: &mut Shared| shared.last < Stamp::from_seconds(last_s) && shared.failed.is_none();
    let (_shared, waited) = came.wait_timeout_while(shared, Duration::from_secs(10), waiting).unwrap();
    assert!(!waited.timed_out());
}

#[test]
fn a_capture_has_the_events_from_before_it_and_no_more() {
    let (mut camera, sender, clock) = camera();
    // One packet a millisecond for 0.5 s, the last one now.
    let now_s = clock.now().seconds();
    for (k, words) in stream(1000, 500).into_iter().enumerate() {
        sender.send(packet(words, now_s - 0.5 + (k + 1) as f64 * 1e-3)).unwrap();
    }
    taken(&camera, now_s);
    camera.begin().unwrap();
    let begun_s = clock.now().seconds();
    for (k, words) in stream(1500, 50).into_iter().enumerate() {
        sender.send(packet(words, begun_s + (k + 1) as f64 * 1e-3)).unwrap();
    }
    taken(&camera, begun_s + 0.05);
    let packets = camera.end().unwrap();
    let times_us = times_us(&packets);
    // 0.2 s before the begin (up to 4.1 ms pass until the next whole time), which came up to the test's own slowness
    // after the last packet.
    let slow_us = ((begun_s - now_s) * 1e6) as i64;
    assert!((1_300_000..=1_306_000 + slow_us).contains(&times_us[0]), "{} {slow_us}", times_us[0]);
    assert_eq!(times_us.last(), Some(&1_549_990));
    assert!(times_us.windows(2).all(|w| w[1] - w[0] == 10), "no gap");
    for packet in &packets {
        assert_eq!(packet.first_us % 1000, 0, "the time of the first word");
    }
    // The next capture begins anew.
    camera.begin().unwrap();
    assert!(camera.end().unwrap().len() <= 250);
}

#[test]
fn the_time_of_a_packet_is_unrolled_over_wraps() {
    let (mut camera, sender, clock) = camera();
    // 16.777 s is where EVT3 wraps.
    let mut at_s = clock.now().seconds();
    camera.begin().unwrap();
    for words in stream(16_700, 200) {
        at_s += 1e-3;
        sender.send(packet(words, at_s)).unwrap();
    }
    taken(&camera, at_s);
    let packets = camera.end().unwrap();
    let expected: Vec<i64> = (0..200).map(|k| 16_700_000 + k * 1000).collect();
    assert_eq!(packets.iter().map(|p| p.first_us).collect::<Vec<_>>(), expected);
}

#[test]
fn lost_packets_fail_the_capture_and_not_the_next() {
    let (mut camera, sender, clock) = camera();
    camera.begin().unwrap();
    let now_s = clock.now().seconds();
    let mut words = stream(100, 3);
    sender.send(packet(words.remove(0), now_s + 0.001)).unwrap();
    let arrived = Stamp::from_seconds(now_s + 0.002);
    sender.send(Ok(Packet { words: words.remove(0), arrived, after_loss: true })).unwrap();
    taken(&camera, now_s + 0.002);
    let lost = camera.end().unwrap_err().to_string();
    assert!(lost.contains("lost 1 times") && lost.contains("diff_on"), "{lost}");
    camera.begin().unwrap();
    sender.send(packet(words.remove(0), clock.now().seconds() + 0.001)).unwrap();
    assert!(camera.end().is_ok());
}

#[test]
fn a_camera_that_is_unplugged_says_so_ever_after() {
    let (mut camera, sender, clock) = camera();
    camera.begin().unwrap();
    sender.send(packet(stream(0, 1).remove(0), clock.now().seconds())).unwrap();
    drop(sender);
    assert!(camera.end().unwrap_err().to_string().contains("unplugged"));
    assert!(camera.begin().unwrap_err().to_string().contains("unplugged"));
}

#[test]
fn a_stream_that_falls_silent_is_told() {
    struct Later(std::sync::atomic::AtomicU64);
    impl Clock for Later {
        fn now(&self) -> Stamp {
            Stamp::from_seconds(self.0.fetch_add(1, Ordering::Relaxed) as f64)
        }
    }
    let (_sender, receiver) = channel();
    let clock = Arc::new(Later(0.into()));
    let source = Box::new(Payloads(receiver));
    let mut camera = StreamedCamera::start(source, CameraFacts::default(), [1280, 720], Format::Evt3, clock).unwrap();
    let silent = (0..4).find_map(|_| camera.begin().err()).unwrap();
    assert!(matches!(silent, CameraError::Silent { .. }), "{silent}");
}

#[test]
fn a_raw_file_plays_at_its_own_pace_again_and_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("short.raw");
    let mut bytes = Header::new(Format::Evt3, 1280, 720).to_bytes();
    stream(50, 100).iter().for_each(|words| bytes.extend(words));
    std::fs::write(&path, &bytes).unwrap();
    let clock: Arc<dyn Clock> = Arc::new(WallClock::starting_at(Stamp::from_seconds(0.0)));
    let mut camera = RawFile::open(&path, [1280, 720], Arc::clone(&clock)).unwrap();
    camera.begin().unwrap();
    taken(&camera, 0.35);
    let packets = camera.end().unwrap();
    let (mut decoder, mut events, mut triggers) = (Decoder::new(Format::Evt3), Vec::new(), Vec::new());
    packets.iter().for_each(|packet| decoder.decode(&packet.words, &mut events, &mut triggers));
    // 100 events a millisecond: three rounds of 0.1 s at least, not faster than time passes.
    let passed_ms = clock.now().seconds() * 1e3;
    assert!(events.len() >= 30_000 - 2_000, "{}", events.len());
    assert!(events.len() as f64 <= 100.0 * passed_ms + 2_000.0, "{} in {passed_ms} ms", events.len());
}

#[test]
fn files_that_cannot_be_played_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.raw");
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let clock: Arc<dyn Clock> = Arc::new(WallClock::starting_at(Stamp::from_seconds(0.0)));
        RawFile::open(&path, [1280, 720], clock).map(|_| ()).unwrap_err().to_string()
    };
    assert!(refused(b"hello").contains("bad.raw"));
    assert!(refused(&Header::new(Format::Evt3, 1280, 720).to_bytes()).contains("no event"));
    assert!(refused(&Header::new(Format::Evt3, 640, 480).to_bytes()).contains("640 x 480"));
}

#[test]
fn what_is_taken_between_is_there_once_and_in_order() {
    let (mut camera, sender, clock) = camera();
    let now_s = clock.now().seconds();
    camera.begin().unwrap();
    let (mut packets, mut last_s) = (Vec::new(), now_s);
    for part in 0..4 {
        for (k, words) in stream(100 * part, 100).into_iter().enumerate() {
            last_s = now_s + (100 * part + k as i64 + 1) as f64 * 1e-3;
            sender.send(packet(words, last_s)).unwrap();
        }
        taken(&camera, last_s);
        packets.extend(camera.take().unwrap());
        assert!(camera.take().unwrap().is_empty());
        // A capture between two parts begins and ends; what comes then is not lost.
        packets.extend(camera.end().unwrap());
        camera.begin().unwrap();
    }
    let expected: Vec<i64> = (0..40_000).map(|i| i * 10).collect();
    assert_eq!(times_us(&packets), expected);
    sender.send(Err("unplugged".into())).unwrap();
    taken(&camera, last_s + 1.0);
    assert!(camera.take().unwrap_err().to_string().contains("unplugged"));
}
