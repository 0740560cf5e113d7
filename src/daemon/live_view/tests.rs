//! The page over a plain socket.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;

use super::*;

fn view() -> LiveView {
    LiveView::start(([127, 0, 0, 1], 0).into(), "bench", &[Camera::Rgb]).unwrap()
}

fn ask(view: &LiveView, request: &str) -> TcpStream {
    let mut stream = TcpStream::connect(view.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    stream
}

fn answer(view: &LiveView, path: &str, host: &str) -> String {
    let mut said = String::new();
    let request = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
    ask(view, &request).read_to_string(&mut said).unwrap();
    said
}

#[test]
fn strangers_are_refused_and_everything_else_is_named() {
    let view = view();
    assert!(answer(&view, "/", "evil.example").starts_with("HTTP/1.1 403"));
    assert!(answer(&view, "/", "localhost:1").contains("page.js"));
    assert!(answer(&view, "/nothing", "127.0.0.1").starts_with("HTTP/1.1 404"));
    assert!(answer(&view, "/event.mjpeg", "127.0.0.1").starts_with("HTTP/1.1 404"), "only rgb is shown");
    let aids = answer(&view, "/aids.json", "127.0.0.1");
    assert!(aids.contains(r#""cameras":["rgb"]"#) && aids.contains("content-security-policy"), "{aids}");
    let mut said = String::new();
    let post = "POST / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";
    ask(&view, post).read_to_string(&mut said).unwrap();
    assert!(said.starts_with("HTTP/1.1 403"), "{said}");
    view.finish();
}

/// Reads until the text has come.
fn read_until(stream: &mut TcpStream, text: &str) -> String {
    let (mut said, mut byte) = (Vec::new(), [0]);
    while !said.ends_with(text.as_bytes()) {
        stream.read_exact(&mut byte).unwrap();
        said.push(byte[0]);
    }
    String::from_utf8(said).unwrap()
}

#[test]
fn a_viewer_gets_the_latest_image_and_one_that_reads_nothing_holds_nobody_up() {
    let view = view();
    let request = "GET /rgb.mjpeg HTTP/1.0\r\nHost: localhost\r\n\r\n";
    let _reads_nothing = ask(&view, request);
    let mut reads = ask(&view, request);
    let head = read_until(&mut reads, "--image\r\n");
    assert!(head.contains("multipart/x-mixed-replace; boundary=image"), "{head}");
    view.publish(Camera::Rgb, b"first".into());
    let part = read_until(&mut reads, "first\r\n--image\r\n");
    assert!(part.contains("Content-Type: image/jpeg\r\nContent-Length: 5\r\n\r\n"), "{part}");
    // Far more than sockets hold: whoever waited for the silent viewer would wait here for ever.
    for _ in 0..100 {
        view.publish(Camera::Rgb, vec![b'.'; 1 << 20]);
    }
    view.publish(Camera::Rgb, b"last".into());
    read_until(&mut reads, "Content-Length: 4\r\n\r\nlast\r\n--image\r\n");
    assert!(view.viewers() >= 1);
    view.publish(Camera::Event, b"of no camera that is shown".into());
    view.finish();
    let mut rest = String::new();
    reads.read_to_string(&mut rest).unwrap();
    assert!(rest.is_empty(), "{rest}");
}
