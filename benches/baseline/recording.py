"""Reads a session of cellcal: images, robot poses, and one event image of each exposure.

Windows are cut by the trigger edges in the event stream: each exposure begins with a rising edge, and the next rising
edge ends it. Which edge belongs to which exposure is found from the clocks. Start at `read_session`.
"""

import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import evt3
import numpy as np
import yaml
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoders
from mcap_ros2.decoder import DecoderFactory as Ros2Decoders

# Sensor times of EVT3 wrap here, microseconds.
EVT3_WRAP_US = 1 << 24


@dataclass
class Capture:
    """One capture of a pose: its exposures, their images, and which packets hold its events."""

    pose: int
    exposures: list
    images: list
    burst: int


@dataclass
class Session:
    """Everything of a recording that the pipeline needs."""

    id: str = ""
    cell: dict = field(default_factory=dict)
    # Id and purpose of each pose; name, both ids and known distance of each pair.
    poses: list = field(default_factory=list)
    pairs: list = field(default_factory=list)
    # The last capture of each pose.
    captures: dict = field(default_factory=dict)
    # Packets that follow each other without a gap.
    bursts: list = field(default_factory=list)
    # Time, and base_from_tcp as x, y, z and rotation vector.
    sample_times_s: np.ndarray = field(default_factory=lambda: np.empty(0))
    sample_poses: np.ndarray = field(default_factory=lambda: np.empty((0, 6)))


def read_session(path):
    """Reads a session in the order in which it was written: images are stamped with the start of their exposure."""
    session, texts = Session(), {}
    images, packets, times, poses = {}, [], [], []
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[ProtobufDecoders(), Ros2Decoders(), JsonDecoders()])
        session.id = next(m.metadata["session_id"] for m in reader.iter_metadata() if m.name == "cellcal")
        texts = {attachment.name: attachment.data.decode() for attachment in reader.iter_attachments()}
        for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            if channel.topic == "/camera/rgb/image/compressed":
                images[message.log_time] = decoded.data
            elif channel.topic == "/event_camera/events":
                packets.append(decoded)
            elif channel.topic != "/session/inputs":
                continue
            elif decoded["input"] == "robot":
                times.append(message.log_time * 1e-9)
                poses.append(decoded["tcp_pose"])
            elif decoded["input"] in ("captured", "capture_failed", "watched"):
                session.bursts.append(packets)
                if decoded["input"] == "captured":
                    add_capture(session, decoded, images)
                images, packets = {}, []
            elif decoded["input"] == "resumed":
                raise SystemExit("resumed sessions have several event clocks; this program reads one")
    session.sample_times_s, session.sample_poses = np.array(times), np.array(poses)
    session.cell = yaml.safe_load(texts["cell.yaml"])
    add_poses(session, texts)
    return session


class JsonDecoders:
    """Decodes the JSON topics."""

    def decoder_for(self, message_encoding, _schema):
        return json.loads if message_encoding == "json" else None


def add_capture(session, captured, images):
    """Keeps a capture with the images of its exposures; a later one of the same pose replaces it."""
    exposures = captured["exposures"]
    found = [images.get(round(exposure["start_s"] * 1e9)) if exposure["image"] else None for exposure in exposures]
    session.captures[captured["pose"]] = Capture(captured["pose"], exposures, found, len(session.bursts) - 1)


def add_poses(session, texts):
    """Names the poses as cellcal does: by trajectory and number, pairs by their own name."""
    names = sorted(name for name in texts if name.startswith("trajectory/"))
    for used, name in zip(session.cell["trajectories"], names, strict=True):
        trajectory = yaml.safe_load(texts[name])
        number = 0
        for segment in trajectory["segments"]:
            ids = segment_ids(segment, trajectory["name"], number)
            number += len(ids)
            session.poses += [{"pose_id": id, "kind": used["purpose"]} for id in ids]
            if segment["pattern"] == "translate":
                for pair, pair_ids in zip(segment["pairs"], zip(ids[::2], ids[1::2])):
                    truth_mm = pair.get("known_mm", np.linalg.norm(pair["displacement_mm"]))
                    session.pairs.append((pair["name"], *pair_ids, truth_mm * 1e-3))


def segment_ids(segment, trajectory, number):
    """Ids of the poses of a segment; `number` poses stand before it."""
    pattern = segment["pattern"]
    if pattern == "translate":
        return [f"{trajectory}-{pair['name']}-{end}" for pair in segment["pairs"] for end in "ab"]
    if pattern in ("views", "joints", "tcp"):
        own = [pose.get("id") for pose in segment["poses"]]
    elif pattern == "grid":
        own = [None] * (segment["columns"] * segment["rows"])
    elif pattern == "orbit":
        own = [None] * sum(ring["count"] for ring in segment["rings"])
    else:
        own = [None] * segment["count"]
    return [id or f"{trajectory}-{number + i:02}" for i, id in enumerate(own, 1)]


@dataclass
class Burst:
    """Decoded events and rising trigger edges, microseconds of the sensor's clock."""

    events: evt3.Events
    start_us: int
    edges_us: np.ndarray


def decode_burst(packets, channel, folder):
    """Decodes packets that follow each other; trigger edges are only decoded from files."""
    path = Path(folder) / "burst.raw"
    header = f"% evt 3.0\n% geometry {packets[0].width}x{packets[0].height}\n% end\n"
    path.write_bytes(header.encode() + b"".join(bytes(packet.events) for packet in packets))
    events, triggers = evt3.decode_file_with_triggers(str(path))
    # The file begins with the time modulo the wrap; `time_base` says which one it was.
    base_us = packets[0].time_base // 1000
    start_us = base_us - base_us % EVT3_WRAP_US
    rising = (triggers.value == 1) & (triggers.id == channel)
    return Burst(events, start_us, triggers.timestamp[rising].astype(np.int64) + start_us)


def decode_bursts(session):
    channel = session.cell["event"].get("trigger_channel", 0)
    with tempfile.TemporaryDirectory() as folder:
        return [decode_burst(packets, channel, folder) if packets else None for packets in session.bursts]


def match_clocks(session, bursts):
    """Host time of a sensor time as a line, seconds: first roughly by the fastest packet, then by the trigger edges."""
    edges_s = np.sort(np.concatenate([burst.edges_us for burst in bursts if burst])) * 1e-6
    starts_s = np.sort([e["start_s"] for capture in session.captures.values() for e in capture.exposures])
    arrivals_s = [
        packet.header.stamp.sec + packet.header.stamp.nanosec * 1e-9 - following.time_base * 1e-9
        for packets in session.bursts
        for packet, following in zip(packets, packets[1:])
    ]
    line = np.array([1.0, min(arrivals_s)])
    for _ in range(3):
        at_s = np.polyval(line, edges_s)
        after = np.clip(np.searchsorted(at_s, starts_s), 1, len(at_s) - 1)
        nearest = np.where(starts_s - at_s[after - 1] < at_s[after] - starts_s, after - 1, after)
        near = np.abs(at_s[nearest] - starts_s) < 0.4 / session.cell["rgb"]["images_per_s"]
        line = np.polyfit(edges_s[nearest[near]], starts_s[near], 1)
    return line


def event_image(size, x, y):
    """The event image of the paper: dark where the last event was ON or OFF, light where there was none."""
    image = np.full((size[1], size[0]), 255, np.uint8)
    image[y, x] = 0
    return cv2.medianBlur(image, 3)


def event_images(session, bursts):
    """One image for each exposure that has a window: from its rising edge to the next one."""
    line = match_clocks(session, bursts)
    size = camera_size(session.cell, "event")
    period_us = 1e6 / session.cell["rgb"]["images_per_s"]
    images = []
    for capture in session.captures.values():
        burst = bursts[capture.burst]
        at_s = np.polyval(line, burst.edges_us * 1e-6)
        for exposure in capture.exposures:
            if exposure.get("closing"):
                continue
            edge = np.argmin(np.abs(at_s - exposure["start_s"]))
            start_us = burst.edges_us[edge]
            end_us = burst.edges_us[edge + 1] if edge + 1 < len(at_s) else start_us + period_us
            t, x, y = burst.events.t, burst.events.x, burst.events.y
            window = slice(*np.searchsorted(t, [start_us - burst.start_us, end_us - burst.start_us]))
            images.append((capture.pose, event_image(size, x[window], y[window])))
    return images


def frame_images(session):
    """Every image of the frame camera with the pose that it observes, still encoded."""
    captures = session.captures.values()
    return [(capture.pose, image) for capture in captures for image in capture.images if image is not None]


def camera_size(cell, camera):
    return cell[camera]["width"], cell[camera]["height"]
