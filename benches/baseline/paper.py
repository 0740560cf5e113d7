"""The pipeline of the paper in plain OpenCV-Python: what `method: paper` of cellcal is measured against.

Reads one session as `cellcal run` recorded it and prints JSON with the keys of our result.json. Written as somebody
who knows OpenCV and numpy would write it, with what PyPI has; it shares no code with cellcal. What it leaves out:
resumed and imported sessions, trajectories by hand, repeated judgement of stillness (the last capture of a pose
counts), outliers of the hand-eye fit, the jackknife.

    python paper.py SESSION.mcap [--time] [--workers N] [--as-detected]
    python paper.py --self-check
"""

import argparse
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from recording import camera_size, decode_bursts, event_images, frame_images, read_session

CAMERAS = ("rgb", "event")
REJECT_ABOVE_PX = 0.75
MIN_CORNERS = 4
# Markers of 0.8 of their square begin at 0.1 squares from a corner.
HALF_WINDOW_SQUARES = 0.08


# ---- corners --------------------------------------------------------------------------------------------------------


def make_board(cell):
    board = cell["board"]
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board["dictionary"]))
    size = (board["squares_x"], board["squares_y"])
    return cv2.aruco.CharucoBoard(size, board["square_mm"] * 1e-3, board["marker_mm"] * 1e-3, dictionary)


def make_detector(board):
    """OpenCV's detector with what finds most event corners: markers missed at first are looked for again."""
    charuco, parameters = cv2.aruco.CharucoParameters(), cv2.aruco.DetectorParameters()
    charuco.tryRefineMarkers = True
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    return cv2.aruco.CharucoDetector(board, charuco, parameters)


def square_px(board, view):
    """Median distance of corners that are neighbours in a row, px; 0 where there are none."""
    columns = board.getChessboardSize()[0] - 1
    pairs = [(id, id + 1) for id in view if id + 1 in view and (id + 1) % columns]
    return float(np.median([np.linalg.norm(view[a] - view[b]) for a, b in pairs])) if pairs else 0.0


def refined(board, image, view):
    """The corners refined once more, in a window that ends before the markers.

    The detector's own windows reach up to the nearest corner of a marker, which is too far where markers fill most of
    their squares: it costs 0.1 to 0.3 px.
    """
    half = max(3, round(HALF_WINDOW_SQUARES * square_px(board, view)))
    corners = np.array(list(view.values()), np.float32).reshape(-1, 1, 2)
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-4)
    corners = cv2.cornerSubPix(image, corners, (half, half), (-1, -1), stop)
    return dict(zip(view, corners.reshape(-1, 2)))


def find_corners(detector, image, as_detected=False):
    """Corners by id; tries again on the negative where nothing is found."""
    for candidate in (image, cv2.bitwise_not(image)):
        corners, ids, _, _ = detector.detectBoard(candidate)
        if ids is not None and len(ids) > 0:
            view = dict(zip(ids.ravel().tolist(), corners.reshape(-1, 2)))
            return view if as_detected else refined(detector.getBoard(), candidate, view)
    return {}


def views_of(found, poses):
    """One view of each pose: the mean of each corner over its images; an empty one where nothing was found."""
    views = {}
    for pose, view in found:
        for id, px in view.items():
            views.setdefault(pose, {}).setdefault(id, []).append(px)
        views.setdefault(pose, {})
    means = {pose: {id: np.mean(px, axis=0) for id, px in sorted(view.items())} for pose, view in views.items()}
    return {pose: means[pose] for pose in range(poses) if pose in means}


def corner_rate(board, views):
    possible = len(board.getChessboardCorners()) * len(views)
    return sum(len(view) for view in views.values()) / possible


# ---- cameras and stereo ---------------------------------------------------------------------------------------------


@dataclass
class Mono:
    """A solved camera; `used` names the poses whose views were kept."""

    matrix: np.ndarray
    distortion: np.ndarray
    rms_px: float
    used: list
    rejected: int
    points: int


def points_of(board, view):
    """Corners in the board and in the image, as OpenCV's solvers take them."""
    ids = list(view)
    return board.getChessboardCorners()[ids], np.array([view[id] for id in ids], np.float32).reshape(-1, 1, 2)


def is_usable(board, view):
    """Enough corners, and not on one line."""
    if len(view) < MIN_CORNERS:
        return False
    plane = board.getChessboardCorners()[list(view)][:, :2]
    return np.linalg.matrix_rank(plane - plane.mean(axis=0), tol=1e-6) == 2


def solve_camera(board, views, size, focal_px):
    """Five distortion terms, from focal length over pixel pitch; one pass that drops views above 0.75 px."""
    poses = [pose for pose, view in views.items() if is_usable(board, view)]
    start = np.array([[focal_px, 0, (size[0] - 1) / 2], [0, focal_px, (size[1] - 1) / 2], [0, 0, 1]])

    def solve(poses):
        objects, images = zip(*(points_of(board, views[pose]) for pose in poses))
        flags, distortion = cv2.CALIB_USE_INTRINSIC_GUESS, np.zeros(5)
        solved = cv2.calibrateCameraExtended(objects, images, size, start.copy(), distortion, flags=flags)
        return solved[0], solved[1], solved[2].ravel(), solved[7].ravel()

    rms_px, matrix, distortion, view_rms_px = solve(poses)
    used = [pose for pose, view_px in zip(poses, view_rms_px) if view_px <= REJECT_ABOVE_PX]
    if len(used) < len(poses):
        rms_px, matrix, distortion, _ = solve(used)
    points = sum(len(views[pose]) for pose in used)
    return Mono(matrix, distortion, rms_px, used, len(views) - len(used), points)


def solve_stereo(board, views, cameras):
    """Intrinsics fixed, corners that both saw; one pass that drops pairs above 0.75 px."""
    rgb, event = cameras["rgb"], cameras["event"]
    both = [pose for pose in views["rgb"] if pose in views["event"]]
    common = {pose: sorted(views["rgb"][pose].keys() & views["event"][pose].keys()) for pose in both}
    seen = {c: {pose: {id: views[c][pose][id] for id in common[pose]} for pose in both} for c in CAMERAS}
    poses = [pose for pose in both if pose in rgb.used and pose in event.used and is_usable(board, seen["rgb"][pose])]

    def solve(poses):
        objects = [points_of(board, seen["rgb"][pose])[0] for pose in poses]
        images = [[points_of(board, seen[c][pose])[1] for pose in poses] for c in CAMERAS]
        known = (rgb.matrix, rgb.distortion, event.matrix, event.distortion)
        start = (np.eye(3), np.zeros((3, 1)))
        # The size of the images only matters where intrinsics are solved.
        solved = cv2.stereoCalibrateExtended(objects, *images, *known, (0, 0), *start, flags=cv2.CALIB_FIX_INTRINSIC)
        # A pair has as many points in one camera as in the other.
        return solved[0], solved[5], solved[6], np.sqrt(np.mean(solved[-1] ** 2, axis=1))

    rms_px, rotation, translation, pair_rms_px = solve(poses)
    used = [pose for pose, pair_px in zip(poses, pair_rms_px) if pair_px <= REJECT_ABOVE_PX]
    if len(used) < len(poses):
        rms_px, rotation, translation, _ = solve(used)
    event_from_rgb = transform(rotation, translation)
    rate = sum(map(len, common.values())) / (len(board.getChessboardCorners()) * len(both))
    return {
        "event_from_rgb": written(event_from_rgb),
        "baseline_m": float(np.linalg.norm(translation)),
        "rotation_deg": float(np.degrees(np.linalg.norm(cv2.Rodrigues(rotation)[0]))),
        "rms_px": rms_px,
        "pairs_used": len(used),
        "pairs_rejected": len(poses) - len(used),
        "corner_rate": rate,
    }


# ---- transforms: 4x4, a_from_b takes b to a -------------------------------------------------------------------------


def transform(rotation, translation):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, np.ravel(translation)
    return matrix


def from_pose_vector(vector):
    return transform(cv2.Rodrigues(np.array(vector[3:], float))[0], vector[:3])


def mean_transform(transforms):
    """Mean position, and the rotation nearest to the mean of the rotation matrices."""
    mean = np.mean(transforms, axis=0)
    u, _, vt = np.linalg.svd(mean[:3, :3])
    return transform(u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt, mean[:3, 3])


def quaternion_xyzw(rotation):
    """w >= 0; exact at half turns, where OpenCV's rotation vectors are too."""
    vector = cv2.Rodrigues(rotation)[0].ravel()
    angle = np.linalg.norm(vector)
    axis = vector / angle if angle > 0 else vector
    return [*(axis * np.sin(angle / 2)).tolist(), float(np.cos(angle / 2))]


def written(matrix):
    return {"translation_m": matrix[:3, 3].tolist(), "quaternion_xyzw": quaternion_xyzw(matrix[:3, :3])}


# ---- hand-eye and checks --------------------------------------------------------------------------------------------


def robot_poses(session):
    """base_from_tcp of every captured pose: mean of the samples from its first exposure to the end of its last."""
    poses = {}
    for pose, capture in session.captures.items():
        span_s = capture.exposures[0]["start_s"], capture.exposures[-1]["end_s"]
        inside = slice(*np.searchsorted(session.sample_times_s, span_s))
        poses[pose] = mean_transform([from_pose_vector(vector) for vector in session.sample_poses[inside]])
    return poses


def board_pose(board, view, camera):
    """Pose of the board from one view: the better planar solution (IPPE), refined; and its RMS."""
    objects, image = points_of(board, view)
    known = (camera.matrix, camera.distortion)
    _, rotations, translations, _ = cv2.solvePnPGeneric(objects, image, *known, flags=cv2.SOLVEPNP_IPPE)
    best = None
    for rotation, translation in zip(rotations, translations):
        rotation, translation = cv2.solvePnPRefineLM(objects, image, *known, rotation, translation)
        projected = cv2.projectPoints(objects, rotation, translation, *known)[0]
        rms_px = np.sqrt(np.mean(np.sum((projected - image) ** 2, axis=2)))
        if best is None or rms_px < best[1]:
            best = transform(cv2.Rodrigues(rotation)[0], translation), rms_px
    return best


def board_poses(board, views, camera):
    """camera_from_target of every usable view that fits."""
    found = {pose: board_pose(board, view, camera) for pose, view in views.items() if is_usable(board, view)}
    return {pose: matrix for pose, (matrix, rms_px) in found.items() if rms_px <= 2 * REJECT_ABOVE_PX}


def tsai(gripper_from_moved, camera_from_target):
    """OpenCV's Tsai; a static camera needs tcp_from_base in the place of base_from_gripper."""
    robot = [(matrix[:3, :3], matrix[:3, 3]) for matrix in gripper_from_moved]
    seen = [(matrix[:3, :3], matrix[:3, 3]) for matrix in camera_from_target]
    solved = cv2.calibrateHandEye(*map(list, zip(*robot)), *map(list, zip(*seen)), method=cv2.CALIB_HAND_EYE_TSAI)
    return transform(*solved)


def solve_hand_eye(carried, base_from_tcp, camera_from_target):
    """`base_from_camera` and `tcp_from_target`, or with carried cameras `tcp_from_camera` and `base_from_target`."""
    base_from_moved = list(base_from_tcp.values())
    moved = base_from_moved if carried == "cameras" else [np.linalg.inv(pose) for pose in base_from_moved]
    seen = [camera_from_target[pose] for pose in base_from_tcp]
    camera = tsai(moved, seen)
    target = mean_transform([robot @ camera @ board for robot, board in zip(moved, seen)])
    return camera, target


def score(distances_m, truth_m):
    distances_m = np.array(distances_m)
    scored = {"count": len(distances_m), "mean_m": float(np.mean(distances_m))}
    if len(distances_m) > 1:
        scored["sigma_m"] = float(np.std(distances_m, ddof=1))
    if truth_m is not None:
        errors_m = distances_m - truth_m
        scored["truth_m"] = truth_m
        scored["bias_m"] = float(np.mean(errors_m))
        scored["mae_m"] = float(np.mean(np.abs(errors_m)))
        scored["max_m"] = float(np.max(np.abs(errors_m)))
    return scored


def target_to_tcp(corner, tcp_from_corner, poses, truth_m):
    """The distance of the corner from the TCP at every pose, and at those that the fit did not use."""
    distances_m = {pose: float(np.linalg.norm(place[:3])) for pose, place in tcp_from_corner.items()}
    held_out = [distances_m[pose] for pose in distances_m if poses[pose]["kind"] != "hand_eye"]
    check = {"corner_id": corner, **score(list(distances_m.values()), truth_m)}
    if held_out:
        check["held_out"] = score(held_out, truth_m)
    check["per_pose"] = [
        {"pose_id": poses[pose]["pose_id"], "distance_m": distance_m} for pose, distance_m in distances_m.items()
    ]
    return check


def target_in_base(corner, base_from_corner, poses):
    """The scatter of the corner in `base`: the check of a cell that carries its cameras."""
    places_m = np.array([place[:3] for place in base_from_corner.values()])
    off_m = np.linalg.norm(places_m - places_m.mean(axis=0), axis=1)
    return {
        "corner_id": corner,
        "count": len(places_m),
        "mean_m": places_m.mean(axis=0).tolist(),
        "sigma_m": float(np.sqrt(np.sum(off_m**2) / (len(off_m) - 1))),
        "max_m": float(off_m.max()),
    }


def base_distance(session, base_from_corner, own_base_from_corner):
    """Distances of the corner between poses, and displacement vectors against the robot's own."""
    index = {pose["pose_id"]: i for i, pose in enumerate(session.poses)}
    per_pair = []
    for name, a, b, truth_m in session.pairs:
        a, b = index[a], index[b]
        if a not in base_from_corner or b not in base_from_corner:
            continue
        seen_m = (base_from_corner[a] - base_from_corner[b])[:3]
        own_m = (own_base_from_corner[a] - own_base_from_corner[b])[:3]
        distance_m = float(np.linalg.norm(seen_m))
        error_m, vector_error_m = distance_m - truth_m, float(np.linalg.norm(seen_m - own_m))
        pair = {"pair": name, "distance_m": distance_m, "truth_m": truth_m, "error_m": error_m}
        per_pair.append({**pair, "vector_error_m": vector_error_m})
    if not per_pair:
        return None
    errors_m = np.array([pair["error_m"] for pair in per_pair])
    return {
        "count": len(per_pair),
        "bias_m": float(errors_m.mean()),
        "mae_m": float(np.abs(errors_m).mean()),
        "sigma_m": float(errors_m.std(ddof=1)),
        "max_m": float(np.abs(errors_m).max()),
        "vector_mae_m": float(np.mean([pair["vector_error_m"] for pair in per_pair])),
        "per_pair": per_pair,
    }


def solve_arm(session, board, views, cameras):
    """Hand-eye of the reference camera, and the checks."""
    cell = session.cell
    carried = cell.get("carried", "target")
    reference = cell.get("settings", {}).get("reference_camera", "event")
    camera_from_target = board_poses(board, views[reference], cameras[reference])
    base_from_tcp = {pose: m for pose, m in robot_poses(session).items() if pose in camera_from_target}
    of_kind = {pose: session.poses[pose]["kind"] for pose in base_from_tcp}
    fitted = {pose: base_from_tcp[pose] for pose, kind in of_kind.items() if kind == "hand_eye"}
    camera, target = solve_hand_eye(carried, fitted, camera_from_target)
    corner_id = cell.get("checks", {}).get("corner_id", 9)
    corner = np.append(board.getChessboardCorners()[corner_id], 1.0)
    judged = {pose: base_from_tcp[pose] for pose, kind in of_kind.items() if kind != "intrinsics"}
    in_camera = {pose: camera_from_target[pose] @ corner for pose in judged}
    hand_eye = {"reference_camera": reference, "method": "tsai", "poses_used": len(fitted)}
    if carried == "cameras":
        hand_eye |= {"tcp_from_camera": written(camera), "base_from_target": written(target)}
        in_base = {pose: judged[pose] @ camera @ in_camera[pose] for pose in judged}
        return hand_eye, {"target_in_base": target_in_base(corner_id, in_base, session.poses)}
    hand_eye |= {"base_from_camera": written(camera), "tcp_from_target": written(target)}
    in_base = {pose: camera @ in_camera[pose] for pose in judged}
    in_tcp = {pose: np.linalg.inv(judged[pose]) @ in_base[pose] for pose in judged}
    own_in_base = {pose: judged[pose] @ target @ corner for pose in judged}
    truth_mm = cell.get("checks", {}).get("target_to_tcp_mm")
    truth_m = truth_mm and truth_mm * 1e-3
    checks = {"target_to_tcp": target_to_tcp(corner_id, in_tcp, session.poses, truth_m)}
    distances = base_distance(session, in_base, own_in_base)
    return hand_eye, checks | ({"base_distance": distances} if distances else {})


# ---- the whole ------------------------------------------------------------------------------------------------------


class Stages:
    """Wall time of each stage, and processor time of all its threads, printed to stderr on demand."""

    def __init__(self, printed):
        self.printed, self.begun = printed, self.now()

    @staticmethod
    def now():
        return time.perf_counter(), time.process_time()

    @contextmanager
    def stage(self, name):
        begun = self.now()
        yield
        self.print(name, begun)

    def print(self, name, begun):
        wall_s, processor_s = (now - then for now, then in zip(self.now(), begun, strict=True))
        if self.printed:
            print(f"{name:<28} {wall_s:8.3f} s  processor {processor_s:8.3f} s", file=sys.stderr)


def find_views(board, images, poses, options):
    """Views of all poses, image by image; inside of each OpenCV works on all cores by itself."""

    def look(item):
        pose, image = item
        return pose, find_corners(make_detector(board), decoded(image), options.as_detected)

    if options.workers == 1:
        return views_of(map(look, images), poses)
    with ThreadPoolExecutor(options.workers) as pool:
        return views_of(pool.map(look, images), poses)


def decoded(image):
    """Images of the frame camera come as the bytes of a file."""
    return cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_GRAYSCALE) if isinstance(image, bytes) else image


def camera_result(board, cell, name, views, camera):
    width, height = camera_size(cell, name)
    (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
    return {
        "width": width,
        "height": height,
        "fx": fx,
        "fy": fy,
        "cx": cx,
        "cy": cy,
        "distortion": camera.distortion.tolist(),
        "rms_px": camera.rms_px,
        "views_used": len(camera.used),
        "views_rejected": camera.rejected,
        "points": camera.points,
        "corner_rate": corner_rate(board, views),
    }


def calibrate(options):
    """From a recording to a result."""
    stages = Stages(options.time)
    with stages.stage("read the recording"):
        session = read_session(options.session)
    cell, board = session.cell, make_board(session.cell)
    with stages.stage("decode events"):
        bursts = decode_bursts(session)
    with stages.stage("match clocks, event images"):
        images = {"rgb": frame_images(session), "event": event_images(session, bursts)}
    views = {}
    for name in CAMERAS:
        with stages.stage(f"corners, {name}"):
            views[name] = find_views(board, images[name], len(session.poses), options)
    cameras = {}
    for name in CAMERAS:
        with stages.stage(f"camera, {name}"):
            focal_px = cell[name]["focal_length_mm"] / cell[name]["pixel_pitch_um"] * 1e3
            cameras[name] = solve_camera(board, views[name], camera_size(cell, name), focal_px)
    with stages.stage("stereo"):
        stereo = solve_stereo(board, views, cameras)
    with stages.stage("hand-eye and checks"):
        hand_eye, checks = solve_arm(session, board, views, cameras)
    stages.print("all", stages.begun)
    return {
        "session_id": session.id,
        "cell": cell["name"],
        "cameras": {name: camera_result(board, cell, name, views[name], cameras[name]) for name in CAMERAS},
        "stereo": stereo,
        "hand_eye": hand_eye,
        "checks": checks,
        "provenance": {"opencv": cv2.__version__, "numpy": np.__version__},
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("session", nargs="?", type=Path, help="a session that `cellcal run` recorded")
    parser.add_argument("--time", action="store_true", help="print the time of each stage to stderr")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="images looked at at once")
    parser.add_argument("--as-detected", action="store_true", help="take corners as OpenCV's detector gives them")
    parser.add_argument("--self-check", action="store_true", help="solve synthetic corners of known cameras")
    options = parser.parse_args()
    if options.self_check:
        # It imports this module.
        import self_check

        return self_check.run()
    if options.session is None:
        parser.error("which session?")
    json.dump(calibrate(options), sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
