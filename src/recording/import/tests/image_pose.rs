//! Layout B: the real ABB set, and small wrong ones.

use super::*;
use crate::geometry::Camera;

const POSE: &str = "x: 0.1\ny: -0.2\nz: 0.5\nqx: 0\nqy: 1.0\nqz: 0.0\nqw: 0.0\n";
const LIST: &str = "data:\n  - image: 0.png\n    pose: 0.yaml\n  - pose: 1.yaml\n    image: sub/1.jpg\n";
const TARGET: &str = "target_finder:\n  type: any\n  rows: 7\n  cols: 5\n  chessboard_dim: 0.036\n  aruco_marker_dim: 0.018\n  dictionary: 10\n";

/// Two images with poses; the folder is inside the temporary one, so that the output can be beside it.
fn small() -> Fixture {
    let fixture = Fixture { dir: tempfile::tempdir().unwrap() };
    fixture.write("cal_data.yaml", LIST);
    fixture.write("rct_target.yaml", TARGET);
    fixture.write_bytes("0.png", &png(16, 12));
    fixture.write_bytes("sub/1.jpg", &jpeg(16, 12));
    fixture.write("0.yaml", POSE);
    fixture.write("1.yaml", POSE);
    fixture
}

fn error_after(change: impl FnOnce(&Fixture) -> &Fixture) -> String {
    let fixture = small();
    change(&fixture);
    let error = fixture.import().unwrap_err().to_string();
    let left = fs::read_dir(fixture.output().parent().unwrap()).map_or(0, |entries| entries.count());
    assert_eq!(left, 0, "something is left after: {error}");
    error
}

#[test]
fn images_and_poses_become_hand_eye_poses() {
    let (report, recording) = small().imported();
    assert_eq!((report.images, report.poses, report.event_bytes, report.notices.len()), (2, 2, 0, 0));
    let setup = recording.import_setup().unwrap();
    assert!(setup.robot_poses && setup.source.contains("base_from_flange, taken as base_from_tcp"), "{}", setup.source);
    assert_eq!(setup.poses.iter().map(|p| p.id.as_str()).collect::<Vec<_>>(), ["0", "1"]);
    assert_eq!((setup.board.squares_x, setup.board.squares_y), (5, 7));
    let captures = captures(&recording);
    assert_eq!((captures[1].1.exposures[0].start_s, captures[1].1.exposures[0].end_s), (1.0, 1.1));
    let declared = captures[1].1.declared.as_ref().unwrap();
    assert_eq!((declared.still_s, declared.base_from_tcp.unwrap().translation_m()), (None, [0.1, -0.2, 0.5]));
    let q = declared.base_from_tcp.unwrap().rotation();
    assert_eq!((q.i, q.j, q.k, q.w), (0.0, 1.0, 0.0, 0.0));
}

#[test]
fn a_given_board_counts_before_the_file_and_without_one() {
    let board = Board { squares_x: 4, squares_y: 3, square_m: 0.02, marker_m: 0.01, dictionary: "DICT_5X5_100".into() };
    let fixture = small();
    fixture.remove("rct_target.yaml");
    let report = fixture.import_with(&ImportOptions { board: Some(board.clone()), ..Default::default() }).unwrap();
    let setup = Recording::open(&report.path).unwrap().import_setup().unwrap();
    assert!(setup.board == board && setup.source.ends_with("board given by --board"), "{}", setup.source);
}

#[test]
fn wrong_files_are_refused_at_their_place() {
    let cases: [(&str, &str, &str, &str); 16] = [
        ("0.yaml", "x: 0.1", "x: .nan", "0.yaml:1:4: x is NaN, not a finite number"),
        ("0.yaml", "x: 0.1", "x: 100", "0.yaml:1:4: x is 100, outside -10 to 10; is it in millimetres"),
        ("0.yaml", "x: 0.1", "x: abc", "0.yaml:1:4: invalid floating point, in `x: abc`"),
        ("1.yaml", "qy: 1.0", "qy: 1.002", "1.yaml:4:5: quaternion of length 1.002, not 1"),
        ("1.yaml", "qy: 1.0\n", "", "1.yaml:6:1: missing field `qy`"),
        ("1.yaml", "qy: 1.0\n", "qy: 1.0\nqy: 1.0\n", "1.yaml:6:1: duplicate mapping key: qy, in `qy: 1.0`"),
        (
            "cal_data.yaml",
            "image: 0.png",
            "image: sub/1.jpg",
            "cal_data.yaml:5:12: image is `sub/1.jpg`, which is in the list already",
        ),
        (
            "cal_data.yaml",
            "image: 0.png",
            "image: 9.png",
            "cal_data.yaml:2:12: image is `9.png`, but there is no such file",
        ),
        ("cal_data.yaml", "1.yaml", "9.yaml", "cal_data.yaml:4:11: pose is `9.yaml`, but there is no such file"),
        ("cal_data.yaml", "    pose: 0.yaml\n", "", "cal_data.yaml:2:5: missing field `pose`"),
        ("cal_data.yaml", LIST, "data: []\n", "cal_data.yaml has no images"),
        ("cal_data.yaml", "data:", "static_camera: false\ndata:", "cal_data.yaml:1:16: static_camera is false"),
        (
            "rct_target.yaml",
            ": 10",
            ": 21",
            "rct_target.yaml:7:15: dictionary is 21; OpenCV numbers its dictionaries 0 to 20",
        ),
        ("rct_target.yaml", "0.018", "0.018e3", "rct_target.yaml:1:1: marker 18 m does not fit its square 0.036 m"),
        ("rct_target.yaml", "  rows: 7\n", "", "rct_target.yaml:6:3: missing field `rows`"),
        ("rct_target.yaml", "rows: 7", "rows: -7", "rct_target.yaml:3:9: invalid u32, in `rows: -7`"),
    ];
    for (file, from, to, expected) in cases {
        let error = error_after(|fixture| fixture.replace(file, from, to));
        assert!(error.starts_with(expected) && !error.contains('\n'), "`{to}`\n found {error}\n expected {expected}");
    }
    let missing = error_after(|fixture| fixture.remove("rct_target.yaml"));
    assert_eq!(missing, "rct_target.yaml is missing; it describes the board: add it or give --board");
    let size = error_after(|fixture| fixture.write_bytes("sub/1.jpg", &jpeg(12, 16)));
    assert!(
        size.starts_with("sub/1.jpg is 12 x 16 pixels, but the first image is 16 x 12 (named in cal_data.yaml:5:12)"),
        "{size}"
    );
}

#[test]
fn a_board_at_the_top_and_unknown_keys_are_understood() {
    let fixture = small();
    fixture.write("rct_target.yaml", &TARGET.replace("target_finder:\n", "").replace("  ", ""));
    fixture.replace("cal_data.yaml", "data:", "static_camera: true\nhomography_threshold: 2.0\ndata:");
    let (report, recording) = fixture.imported();
    assert_eq!(report.notices, ["ignored unknown keys: cal_data.yaml: homography_threshold"]);
    assert_eq!(recording.import_setup().unwrap().board.square_m, 0.036);
}

#[test]
fn the_real_abb_set_is_imported_unchanged() {
    let Some(data) = std::env::var_os("CELLCAL_DATA") else {
        eprintln!("skipped: CELLCAL_DATA does not name the folder of recordings");
        return;
    };
    let folder = PathBuf::from(data).join("rct_charuco_static_camera");
    let dir = tempfile::tempdir().unwrap();
    let report = import_folder(&folder, &dir.path().join("abb.mcap"), &ImportOptions::default()).unwrap();
    assert_eq!((report.poses, report.images), (16, 16));
    let recording = Recording::open(&report.path).unwrap();
    let setup = recording.import_setup().unwrap();
    assert_eq!((setup.cameras[&Camera::Rgb].width, setup.cameras[&Camera::Rgb].height), (1600, 1200));
    assert_eq!((setup.board.squares_x, setup.board.squares_y, setup.board.dictionary.as_str()), (5, 7, "DICT_6X6_250"));
    let mut images = recording.entries.iter().filter_map(|e| if let Entry::Image(_, i) = e { Some(i) } else { None });
    for (index, (_, capture)) in captures(&recording).into_iter().enumerate() {
        assert_eq!((capture.pose, setup.poses[index].id.clone()), (index, index.to_string()));
        assert_eq!(*images.next().unwrap(), fs::read(folder.join(format!("images/{index}.png"))).unwrap());
    }
    // Numbers of poses/0.yaml.
    let first = captures(&recording)[0].1.declared.as_ref().unwrap().base_from_tcp.unwrap();
    assert_eq!(first.translation_m(), [0.113074204220918, 0.5892802789268905, 0.652673790716681]);
    assert!((first.rotation().w - 0.2389701531981282).abs() < 1e-12);
}
