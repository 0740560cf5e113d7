//! The target as a video and on paper, checked by looking at what was written.

use std::path::Path;
use std::process::Command;

use cellcal::board::{Board, View};
use cellcal::cv::charuco::{self, Look};
use cellcal::cv::{codec, video_file};
use cellcal::image::GrayImage;

use crate::support::{expect, stderr, text};
use crate::target_page::truth;

fn board() -> Board {
    Board { squares_x: 7, squares_y: 5, square_m: 0.012, marker_m: 0.0096, dictionary: "DICT_4X4_50".into() }
}

/// Correlation of two images, -1 to 1.
fn correlation(a: &GrayImage, b: &GrayImage) -> f64 {
    let mean = |i: &GrayImage| i.pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / i.pixels.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let sums = a.pixels.iter().zip(&b.pixels).fold([0.0; 3], |[ab, aa, bb], (a, b)| {
        let (a, b) = (f64::from(*a) - mean_a, f64::from(*b) - mean_b);
        [ab + a * b, aa + a * a, bb + b * b]
    });
    sums[0] / (sums[1] * sums[2]).sqrt()
}

fn mean_difference(a: &GrayImage, b: &GrayImage) -> f64 {
    let sum: u64 = a.pixels.iter().zip(&b.pixels).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.pixels.len() as f64
}

/// A short video, decoded again: states in order, count, rate, size, codec.
fn check_video(encoder: &str, fps: usize, largest_mean_difference: f64) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("target.mp4");
    let rate = fps.to_string();
    // 12.1 s: more than one piece, and not a whole number of pieces.
    let common = ["target", "video", text(&file), "--minutes", "0.2017", "--size", "800x480", "--fps", &rate];
    expect(0, &[&common[..], &["--encoder", encoder]].concat());
    // 75 px a square, 10 a module, are the most that leave half a square of white.
    let (pattern, blended) = (truth(&board(), 75, None, [800, 480]), truth(&board(), 75, Some(0.6), [800, 480]));
    // Both have the same shapes: what tells them apart is how dark the dark is, and that both are ours.
    let (mut states, mut worst) = (Vec::new(), 0.0_f64);
    let facts = video_file::decode_each(&file, |image| {
        let differences = [&pattern, &blended].map(|truth| mean_difference(image, truth));
        let state = usize::from(differences[1] < differences[0]);
        let truth = [&pattern, &blended][state];
        assert!(correlation(image, truth) > 0.999, "image {}: {}", states.len(), correlation(image, truth));
        worst = worst.max(differences[state]);
        states.push(state);
    });
    let facts = facts.unwrap();
    eprintln!("{encoder}, {fps} a second: {facts:?}, {} images, worst mean difference {worst:.3}", states.len());
    assert!(worst < largest_mean_difference, "{worst}");
    let images = (0.2017_f64 * 60.0 * fps as f64).ceil() as usize;
    assert_eq!(states.len(), images.next_multiple_of(fps / 15));
    for (index, state) in states.iter().enumerate() {
        assert_eq!(*state, index / (fps / 30) % 2, "image {index}");
    }
    assert_eq!((facts.size_px, facts.fps), ([800, 480], fps as f64));
    assert!(["avc1", "h264"].contains(&facts.codec.as_str()), "{}", facts.codec);
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 1, "{left:?}");
}

/// Whether a program that only tests and videos need is there; a failure where it is missing without leave.
fn has(program: &str, package: &str, variable: &str) -> bool {
    if std::env::var(variable).is_ok_and(|v| v == "no") {
        eprintln!("skipped: {variable}=no, so there is no {program} to test with");
        return false;
    }
    let found = Command::new(program).arg("-h").output();
    assert!(found.is_ok(), "{program} is missing: apt-get install {package}, or set {variable}=no");
    true
}

#[test]
fn a_video_of_ffmpeg_alternates_exactly() {
    if has("ffmpeg", "ffmpeg", "CELLCAL_FFMPEG") {
        check_video("ffmpeg", 30, 1.0);
        check_video("ffmpeg", 60, 1.0);
    }
}

#[test]
fn a_video_of_opencv_alternates_exactly() {
    // OpenCV chooses the bit rate: edges blur. Measured 2.87 gray levels, against 0.45 of ffmpeg.
    check_video("opencv", 30, 4.0);
}

#[test]
fn videos_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("target.mp4");
    for (more, said) in [
        (["--size", "801x480"], "needs even numbers"),
        (["--size", "60x60"], "at least 8 are needed"),
        (["--fps", "25"], "30 or 60"),
        (["--minutes", "NaN"], "outside 0.01 to 240"),
        (["--alpha", "1"], "outside 0 to 0.95"),
    ] {
        let output = expect(2, &[&["target", "video", text(&file)][..], &more].concat());
        assert!(stderr(&output).contains(said), "{more:?}: {}", stderr(&output));
    }
    assert!(!file.exists());
}

/// The page as a printer of 600 dpi would print it.
fn printed(pdf: &Path) -> GrayImage {
    let to = pdf.with_extension("");
    let rendered = Command::new("pdftoppm")
        .args(["-r", "600", "-gray", "-singlefile"])
        .args([pdf, to.as_path()])
        .status()
        .unwrap();
    assert!(rendered.success());
    codec::decode_gray(&std::fs::read(pdf.with_extension("pgm")).unwrap()).unwrap()
}

/// Largest error of the distance between two corners, mm.
fn worst_distance_mm(board: &Board, view: &View) -> f64 {
    let mut worst = 0.0_f64;
    for a in &view.corners {
        for b in &view.corners {
            let found = (a.px[0] - b.px[0]).hypot(a.px[1] - b.px[1]) / 600.0 * 25.4;
            let [p, q] = [a, b].map(|c| board.corner(c.id).unwrap().xyz_m());
            worst = worst.max((found - (p[0] - q[0]).hypot(p[1] - q[1]) * 1e3).abs());
        }
    }
    worst
}

#[test]
fn paper_has_every_corner_where_it_belongs() {
    if !has("pdftoppm", "poppler-utils", "CELLCAL_PDFTOPPM") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("target.pdf");
    let tall =
        Board { squares_x: 5, squares_y: 8, square_m: 0.03, marker_m: 0.0225, dictionary: "DICT_6X6_250".into() };
    let options = ["--squares", "5x8", "--square-mm", "30", "--marker-mm", "22.5", "--dictionary", "DICT_6X6_250"];
    for (board, options, paper) in [(board(), &[][..], "letter"), (tall, &options[..], "a4")] {
        expect(0, &[&["target", "pdf", text(&file), "--paper", paper][..], options].concat());
        let page = printed(&file);
        let view = charuco::find_corners(&board, &page, Look::Frame).unwrap();
        assert_eq!(view.corners.len(), board.corner_count(), "{paper}");
        let worst = worst_distance_mm(&board, &view);
        eprintln!("{paper}: {} corners, worst distance {worst:.4} mm off", view.corners.len());
        assert!(worst < 0.05, "{paper}: {worst} mm");
        assert_rulers(&page);
    }
}

/// Both rulers are 100 mm long, to a dot of the printer and its line width.
fn assert_rulers(page: &GrayImage) {
    let dark = |x: usize, y: usize| page.at(x, y) < 128;
    let longest = |line: &mut dyn Iterator<Item = bool>| {
        let (mut run, mut longest) = (0_usize, 0_usize);
        for dark in line {
            run = if dark { run + 1 } else { 0 };
            longest = longest.max(run);
        }
        longest as f64 / 600.0 * 25.4
    };
    let mm = 600.0 / 25.4;
    let footer = page.height - (20.0 * mm) as usize;
    let across = (footer..page.height).map(|y| longest(&mut (0..page.width).map(|x| dark(x, y)))).fold(0.0, f64::max);
    let side = page.width - (14.0 * mm) as usize;
    let down = (side..page.width).map(|x| longest(&mut (0..page.height).map(|y| dark(x, y)))).fold(0.0, f64::max);
    // End marks are 0.2 mm wide, half of it outside.
    for length in [across, down] {
        assert!((length - 100.2).abs() < 0.1, "{across} across, {down} down");
    }
}

#[test]
fn a_board_too_large_for_paper_is_told_which_would_do() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("target.pdf");
    let output = expect(2, &["target", "pdf", text(&file), "--square-mm", "45"]);
    assert!(
        stderr(&output).contains("too large for a4") && stderr(&output).contains("it fits on a3"),
        "{}",
        stderr(&output)
    );
    let output = expect(2, &["target", "pdf", text(&file), "--paper", "a5"]);
    assert!(stderr(&output).contains("use a4, a3 or letter"), "{}", stderr(&output));
    assert!(!file.exists());
}
