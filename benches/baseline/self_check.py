"""Solves synthetic corners of known cameras: does `paper.py` give back the truth?"""

import sys

import cv2
import numpy as np

import paper
from paper import CAMERAS, from_pose_vector


def check_cameras(noise_px):
    """Solves cameras, stereo and hand-eye from projected corners; returns the largest errors found."""
    random = np.random.default_rng(1)
    cell = {"board": {"dictionary": "DICT_4X4_50", "squares_x": 7, "squares_y": 5, "square_mm": 8.8, "marker_mm": 7.04}}
    board, sizes = paper.make_board(cell), {"rgb": (1380, 780), "event": (1280, 720)}
    corners = board.getChessboardCorners()
    truth = {
        "rgb": (np.array([[2760.0, 0, 700], [0, 2768.0, 380], [0, 0, 1]]), np.array([-0.2, 0.3, 4e-4, -3e-4, 0])),
        "event": (np.array([[2480.0, 0, 630], [0, 2475.0, 370], [0, 0, 1]]), np.array([-0.1, 0.2, -5e-4, 2e-4, 0])),
    }
    event_from_rgb = from_pose_vector([0.0344, 4e-4, -2e-4, 0.004, 0.015, -0.006])
    base_from_event = from_pose_vector([0.125, -0.563, 0.382, 3.1, 0.02, -0.03])
    tcp_from_target = from_pose_vector([-0.0352, 0.009, 0.0496, 1.57, 0.02, -0.01])
    views, base_from_tcp = {"rgb": {}, "event": {}}, {}
    for pose in range(40):
        tilt = random.uniform([-0.5, -0.5, -0.6], [0.5, 0.5, 0.6])
        centre = random.uniform([0.002, -0.012, 0.27], [0.032, 0.012, 0.33])
        event_from_target = from_pose_vector([*centre, *tilt]) @ from_pose_vector([-0.0308, -0.022, 0, 0, 0, 0])
        base_from_tcp[pose] = base_from_event @ event_from_target @ np.linalg.inv(tcp_from_target)
        for name, pose_of in (("event", event_from_target), ("rgb", np.linalg.inv(event_from_rgb) @ event_from_target)):
            rotation = cv2.Rodrigues(pose_of[:3, :3])[0]
            px = cv2.projectPoints(corners, rotation, pose_of[:3, 3], *truth[name])[0].reshape(-1, 2)
            views[name][pose] = dict(enumerate(px + random.normal(0, noise_px, px.shape) if noise_px else px))
    cameras = {name: paper.solve_camera(board, views[name], sizes[name], 2600.0) for name in CAMERAS}
    stereo = paper.solve_stereo(board, views, cameras)
    seen = paper.board_poses(board, views["event"], cameras["event"])
    camera, target = paper.solve_hand_eye("target", base_from_tcp, seen)
    carried = {pose: np.linalg.inv(base_from_tcp[pose]) for pose in base_from_tcp}
    carried_camera, _ = paper.solve_hand_eye("cameras", carried, seen)
    return {
        "focal_px": max(abs(cameras[n].matrix[i, i] - truth[n][0][i, i]) for n in CAMERAS for i in (0, 1)),
        "rms_px": [cameras[name].rms_px for name in CAMERAS] + [stereo["rms_px"]],
        "baseline_m": abs(stereo["baseline_m"] - np.linalg.norm(event_from_rgb[:3, 3])),
        "camera_m": np.linalg.norm((camera - base_from_event)[:3, 3]),
        "target_m": np.linalg.norm((target - tcp_from_target)[:3, 3]),
        "carried_camera_m": np.linalg.norm((carried_camera - base_from_event)[:3, 3]),
        "points": sum(map(len, views["rgb"].values())),
    }


def check_detection():
    """Largest error of the corners of a drawn board, px; with a file as the frame camera gives it."""
    cell = {"board": {"dictionary": "DICT_4X4_50", "squares_x": 7, "squares_y": 5, "square_mm": 12, "marker_mm": 9.6}}
    board = paper.make_board(cell)
    drawn = cv2.copyMakeBorder(board.generateImage((700, 500)), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    drawn = cv2.GaussianBlur(drawn, (0, 0), 1.0)
    view = paper.find_corners(paper.make_detector(board), paper.decoded(cv2.imencode(".png", drawn)[1].tobytes()))
    # An edge lies between two pixels: half a pixel before the first pixel of the next square.
    truth = board.getChessboardCorners()[:, :2] / 0.012 * 100 + 60 - 0.5
    return len(view), max(np.linalg.norm(view[id] - truth[id]) for id in view)


def run():
    """Exact corners must give back the truth; noisy ones an error as large as the noise says."""
    exact, noise_px = check_cameras(0.0), 0.1
    noisy = check_cameras(noise_px)
    count, corner_px = check_detection()
    # |e| of two coordinates is sqrt(2) noises; every view takes 6 of its 48 numbers for its pose. The relative sigma
    # of an RMS over n numbers is 1 / sqrt(2 n).
    expected_px = np.sqrt(2) * noise_px * np.sqrt(1 - 6 / 48)
    slack_px = 5 * expected_px / np.sqrt(2 * 2 * noisy["points"] * (1 - 6 / 48))
    # A pair shares one pose: 6 of 96 numbers.
    expected_stereo_px = np.sqrt(2) * noise_px * np.sqrt(1 - 6 / 96)
    off_px = np.abs(np.array(noisy["rms_px"]) - [expected_px, expected_px, expected_stereo_px])
    found = {
        "exact: rms, px": (max(exact["rms_px"]), 1e-3),
        "exact: focal length, px": (exact["focal_px"], 0.05),
        "exact: baseline, m": (exact["baseline_m"], 1e-6),
        "exact: static camera, m": (exact["camera_m"], 1e-5),
        "exact: target on the tool, m": (exact["target_m"], 1e-5),
        "exact: carried camera, m": (exact["carried_camera_m"], 1e-5),
        "noisy: rms of a camera off the expected, px": (max(off_px[:2]), slack_px),
        "noisy: rms of the pair off the expected, px": (off_px[2], slack_px),
        "drawn board: corners missed": (24 - count, 0),
        "drawn board: largest error of a corner, px": (corner_px, 0.05),
    }
    missed = [name for name, (value, limit) in found.items() if not value <= limit]
    for name, (value, limit) in found.items():
        print(f"{'MISSED' if name in missed else 'ok':<7} {name}: {value:.3g}, allowed {limit:.3g}", file=sys.stderr)
    sys.exit(1 if missed else 0)
