//! The page that blinks, in a real browser: counting, pixels, sizes, and what its server answers to whom.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use cellcal::board::{self, Board};
use cellcal::config::{self, Cell};
use cellcal::cv::charuco;
use cellcal::image::GrayImage;
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};
use tokio_rustls::rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use tokio_rustls::rustls::crypto::{CryptoProvider, ring, verify_tls12_signature, verify_tls13_signature};
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, DigitallySignedStruct, Error, SignatureScheme, Stream};

use crate::chromium::Chromium;
use crate::support::text;

/// Callbacks come when the test says so, at the time it says.
const FAKE_CLOCK: &str = "window.fake = { waiting: [], now: 1000, step(ms) {
    this.now += ms; const due = this.waiting; this.waiting = []; for (const f of due) f(this.now); } };
  window.requestAnimationFrame = (f) => fake.waiting.push(f);";

/// The program, serving.
struct Server {
    child: Child,
    stdout: BufReader<ChildStdout>,
    url: String,
}

impl Server {
    fn start(more: &[&str]) -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_cellcal"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["target", "serve", "--listen", "127.0.0.1:0"])
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        let mut url = String::new();
        stdout.read_line(&mut url).unwrap();
        Self { child, stdout, url: url.trim().to_owned() }
    }

    fn address(&self) -> &str {
        self.url.split("//").nth(1).unwrap()
    }

    /// Sends these bytes; the whole answer as text.
    fn raw(&self, request: &[u8]) -> String {
        let mut stream = TcpStream::connect(self.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request).unwrap();
        let mut answer = Vec::new();
        // A server that hangs up on us has answered, too.
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn get(&self, path: &str) -> String {
        let host = self.address();
        self.raw(format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n").as_bytes())
    }

    fn post(&self, path: &str, headers: &str, body: &str) -> String {
        let (host, length) = (self.address(), body.len());
        let request = format!(
            "POST {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\ncontent-type: application/json\r\n\
             content-length: {length}\r\n{headers}\r\n{body}"
        );
        self.raw(request.as_bytes())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn cell() -> Cell {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("cells/handheld.yaml")).unwrap();
    config::parse_cell(&text, "cells/handheld.yaml").unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// Every refresh shows what its number says; none is missing in the list.
fn assert_alternates(history: &Value, k: u64) {
    let history = history.as_array().unwrap();
    let first = history[0][0].as_u64().unwrap();
    for (n, entry) in (first..).zip(history) {
        assert_eq!(entry[0].as_u64(), Some(n), "refreshes are counted one by one");
        assert_eq!(entry[1].as_u64(), Some(n / k % 2), "state at refresh {n} with {k} a state");
    }
}

#[test]
fn states_alternate_exactly_over_600_refreshes() {
    let Some(mut chromium) = Chromium::start() else { return };
    let server = Server::start(&["cells/handheld.yaml"]);
    // A machine that is busy with other tests refreshes unevenly: the page says so, and is asked again.
    let blinks = (0..20).any(|_| {
        chromium.open(&format!("{}/?start", server.url));
        chromium.until("window.cellcal && cellcal.phase === 'menu' || window.cellcal && cellcal.history.length >= 600");
        chromium.value("cellcal.phase") == json!("blinking")
    });
    assert!(blinks, "{}", chromium.value("cellcal.message"));
    let [k, hz] = ["cellcal.k", "cellcal.refresh_hz"].map(|e| number(&chromium.value(e)));
    assert!((hz / 30.0 / k - 1.0).abs() < 0.005, "{k} refreshes a state at {hz} Hz");
    let history = chromium.value("cellcal.history");
    assert!(history.as_array().unwrap().len() >= 600);
    assert_alternates(&history, k as u64);
    chromium.until("cellcal.history.length === 1200");
    assert_alternates(&chromium.value("cellcal.history"), k as u64);
    assert_eq!(chromium.value("document.getElementById('menu').hidden"), json!(true));
    chromium.press("Escape");
    assert_eq!(chromium.value("cellcal.phase"), json!("menu"));
    assert!(chromium.value("cellcal.message").as_str().unwrap().contains("dropped"));
}

/// Opens the page, lets it measure `hz`, and says how it goes on.
fn measured_at(chromium: &mut Chromium, url: &str, hz: f64) -> String {
    chromium.open(url);
    chromium.until("window.cellcal && cellcal.phase === 'measuring' && fake.waiting.length > 0");
    chromium.value(&format!("for (let i = 0; i < 161; i++) fake.step(1000 / {hz}); cellcal.phase")).to_string()
}

#[test]
fn rates_that_fit_blink_and_others_are_refused() {
    let Some(mut chromium) = Chromium::start() else { return };
    chromium.before_pages(FAKE_CLOCK);
    let server = Server::start(&["cells/handheld.yaml"]);
    let url = format!("{}/?start", server.url);
    for (hz, k) in [(30.0, 1), (59.94, 2), (60.0, 2), (90.0, 3), (120.0, 4), (240.0, 8)] {
        assert_eq!(measured_at(&mut chromium, &url, hz), "\"blinking\"", "{hz}");
        assert_eq!(chromium.value("cellcal.k"), json!(k), "{hz}");
        assert!((number(&chromium.value("cellcal.refresh_hz")) / hz - 1.0).abs() < 1e-9);
        // What is on the screen after each callback, not what the page says about it.
        let step =
            format!("fake.step(1000 / {hz}); seen.push(getComputedStyle(document.getElementById('a')).visibility)");
        let seen = chromium.value(&format!("{{ const seen = []; for (let i = 0; i < 700; i++) {{ {step} }} seen }}"));
        let truth = (0..700).map(|n| if n / k % 2 == 0 { "visible" } else { "hidden" });
        assert!(truth.eq(seen.as_array().unwrap().iter().map(|v| v.as_str().unwrap())), "{hz}");
        assert_alternates(&chromium.value("cellcal.history"), k);
        assert_eq!(chromium.value("cellcal.dropped"), json!(0));
    }
    for (hz, offers) in [(75.0, [12.5, 18.75]), (144.0, [14.4, 18.0]), (165.0, [13.75, 16.5])] {
        assert_eq!(measured_at(&mut chromium, &url, hz), "\"menu\"", "{hz}");
        let found = chromium.value("cellcal.offers");
        let found: Vec<f64> = found.as_array().unwrap().iter().map(number).collect();
        let mut sorted = found.clone();
        sorted.sort_by(f64::total_cmp);
        assert!(sorted.iter().zip(offers).all(|(a, b)| (a - b).abs() < 1e-6), "{hz}: {found:?}");
        assert!((found[0] - 15.0).abs() <= (found[1] - 15.0).abs(), "{hz}: the nearest first, {found:?}");
        assert_eq!(chromium.value("document.getElementById('start').disabled"), json!(true));
        // One of the offers is taken.
        chromium.value("document.querySelector('#offers button').click()");
        chromium.until("cellcal.phase === 'measuring' && fake.waiting.length > 0");
        chromium.value(&format!("for (let i = 0; i < 161; i++) fake.step(1000 / {hz})"));
        assert!((number(&chromium.value("cellcal.cycle_hz")) - found[0]).abs() < 1e-3);
        assert!(chromium.value("location.search").as_str().unwrap().contains("cycle_hz="), "kept in the address");
        assert_eq!(chromium.value("document.getElementById('start').disabled"), json!(false));
    }
}

#[test]
fn dropped_refreshes_are_counted_and_another_rate_is_measured_anew() {
    let Some(mut chromium) = Chromium::start() else { return };
    chromium.before_pages(FAKE_CLOCK);
    let server = Server::start(&["cells/handheld.yaml"]);
    let url = format!("{}/?start", server.url);
    assert_eq!(measured_at(&mut chromium, &url, 60.0), "\"blinking\"");
    // 40 refreshes, one that nobody drew, 40 more, three that nobody drew, 20 more.
    chromium.value(
        "const p = 1000 / 60; for (const [count, last] of [[40, 2 * p], [39, 4 * p], [20, p]]) {
           for (let i = 0; i < count; i++) fake.step(p); fake.step(last); }",
    );
    assert_eq!(chromium.value("cellcal.dropped"), json!(4));
    assert_eq!(chromium.value("cellcal.drops"), json!([[40, 1], [80, 3]]));
    assert_alternates(&chromium.value("cellcal.history"), 2);
    chromium.value("document.getElementById('stage').click()");
    let said = chromium.value("cellcal.message");
    assert!(said.as_str().unwrap().contains("4 dropped"), "{said}");

    for hz in [120.0, 50.0, 30.0] {
        assert_eq!(measured_at(&mut chromium, &url, 60.0), "\"blinking\"");
        chromium
            .value(&format!("for (let i = 0; i < 300 && cellcal.phase === 'blinking'; i++) fake.step(1000 / {hz})"));
        chromium.until("cellcal.phase === 'measuring'");
        chromium.value(&format!("for (let i = 0; i < 161; i++) fake.step(1000 / {hz})"));
        assert!((number(&chromium.value("cellcal.refresh_hz")) / hz - 1.0).abs() < 1e-9, "{hz}");
    }
    // Another size of the window, too.
    assert_eq!(measured_at(&mut chromium, &url, 60.0), "\"blinking\"");
    chromium.resize(640, 400);
    chromium.until("cellcal.phase === 'measuring' && cellcal.panel_px[0] === 640");
    assert_eq!(chromium.value("cellcal.refresh_hz"), Value::Null);
    // Callbacks that come anyhow are no rate.
    chromium.value("for (let i = 0; i < 161; i++) fake.step(i % 2 ? 4 : 30)");
    assert!(chromium.value("cellcal.message").as_str().unwrap().contains("unevenly"));
}

/// What the screen must show: the board in the middle of white.
pub(crate) fn truth(board: &Board, px: u32, alpha: Option<f64>, [width, height]: [usize; 2]) -> GrayImage {
    let mut drawn = board::raster(board, &charuco::markers(board).unwrap(), px);
    if let Some(alpha) = alpha {
        drawn = board::blend_with_white(&drawn, alpha);
    }
    let mut screen = GrayImage::filled(width, height, 255);
    let (left, top) = ((width - drawn.width) / 2, (height - drawn.height) / 2);
    for (row, line) in drawn.pixels.chunks(drawn.width).enumerate() {
        screen.pixels[(top + row) * width + left..][..drawn.width].copy_from_slice(line);
    }
    screen
}

#[test]
fn both_states_are_our_images_pixel_for_pixel_on_any_screen() {
    let server = Server::start(&["cells/handheld.yaml"]);
    let cell = cell();
    // A monitor, one at 125 %, the 3.5-inch panel, phones of 3 and 2.625 device pixels a point.
    let screens = [(1920, 1080, 1.0), (1536, 864, 1.25), (480, 320, 1.0), (844, 390, 3.0), (915, 412, 2.625)];
    for (width, height, ratio) in screens {
        let Some(mut chromium) = Chromium::with_screen([width, height], ratio) else { return };
        for (key, alpha) in [("a", None), ("b", Some(cell.display.alpha))] {
            chromium.open(&format!("{}/?state={key}", server.url));
            chromium.until("window.cellcal && cellcal.phase === 'held'");
            let px = chromium.value("cellcal.board.px").as_u64().unwrap() as u32;
            assert_eq!(px % 15, 0, "whole pixels a module");
            let shown = chromium.screenshot();
            let of_screen = [width, height].map(|points| f64::from(points) * ratio);
            for (found, truth) in [shown.width, shown.height].into_iter().zip(of_screen) {
                assert!((found as f64 - truth).abs() <= 1.0, "{found} pixels, {truth} at a ratio of {ratio}");
            }
            let truth = truth(&cell.board, px, alpha, [shown.width, shown.height]);
            let wrong = shown.pixels.iter().zip(&truth.pixels).filter(|(a, b)| a != b).count();
            assert_eq!(wrong, 0, "{width}x{height} at {ratio}, state {key}: pixels that differ");
        }
    }
}

#[test]
fn another_board_is_drawn_and_what_cannot_be_is_refused_with_a_sentence() {
    let Some(mut chromium) = Chromium::start() else { return };
    let server = Server::start(&["--squares", "9x6", "--dictionary", "DICT_5X5_100", "--marker-mm", "8.4"]);
    chromium.resize(1280, 800);
    chromium.open(&format!("{}/?state=b&alpha=0.3&dictionary=DICT_6X6_250&marker_mm=9&squares_x=5", server.url));
    chromium.until("window.cellcal && cellcal.phase === 'held'");
    let board =
        Board { squares_x: 5, squares_y: 6, square_m: 0.012, marker_m: 0.009, dictionary: "DICT_6X6_250".into() };
    let px = chromium.value("cellcal.board.px").as_u64().unwrap() as u32;
    assert!(px >= 96 && px.is_multiple_of(32), "{px}");
    let shown = chromium.screenshot();
    assert!(shown == truth(&board, px, Some(0.3), [shown.width, shown.height]));
    for (query, said) in [
        ("dictionary=DICT_1", "unknown ArUco dictionary `DICT_1`"),
        ("squares_x=90&squares_y=90", "the board needs 4050 markers"),
        ("squares_x=100&squares_y=3&dictionary=DICT_4X4_1000&marker_mm=9.6", "a board of 100 x 3 squares needs"),
        ("alpha=nought", "alpha is `nought`, not a number"),
        ("px=41&marker_mm=9", "multiples of"),
    ] {
        chromium.open(&format!("{}/?state=a&{query}", server.url));
        chromium.until("window.cellcal && cellcal.phase === 'menu'");
        let message = chromium.value("cellcal.message");
        assert!(message.as_str().unwrap().contains(said), "{query}: {message}");
    }
}

#[test]
fn a_measured_size_reaches_the_file_and_the_terminal() {
    let Some(mut chromium) = Chromium::start() else { return };
    chromium.before_pages(FAKE_CLOCK);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("display.json");
    let mut server = Server::start(&["cells/handheld.yaml", "-o", text(&file)]);
    chromium.resize(800, 480);
    assert_eq!(measured_at(&mut chromium, &server.url.clone(), 60.0), "\"menu\"");
    chromium.value("document.getElementById('size').click()");
    // The row on the screen is 9 fields, black at both ends, of whole pixels.
    let shown = chromium.screenshot();
    let row: Vec<u8> = (0..shown.width).map(|x| shown.at(x, 6)).collect();
    let (first, last) = (row.iter().position(|v| *v == 0).unwrap(), row.iter().rposition(|v| *v == 0).unwrap());
    let length = last + 1 - first;
    assert_eq!(length % 9, 0);
    let column: Vec<u8> = (0..shown.height).map(|y| shown.at(6, y)).collect();
    let height = column.iter().rposition(|v| *v == 0).unwrap() + 1 - column.iter().position(|v| *v == 0).unwrap();
    // A panel of 0.1 mm a pixel.
    let fill = |name: &str, mm: f64| format!("document.querySelector('[name={name}]').value = '{mm}';");
    chromium.value(&(fill("x_mm", length as f64 * 0.1) + &fill("y_mm", height as f64 * 0.1) + &fill("sigma_mm", 0.05)));
    chromium.value("document.querySelector('#readings button').click()");
    chromium.until("document.getElementById('measured').textContent");
    assert_eq!(chromium.value("document.getElementById('lines').hidden"), json!(false));
    let px = number(&chromium.value("cellcal.board.px"));
    let kept: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    assert!((number(&kept["square_mm"][0]) - px * 0.1).abs() < 1e-9, "{kept}");
    assert!((number(&kept["square_sigma_mm"][0]) - 0.05 * px / length as f64).abs() < 1e-9, "{kept}");
    assert!((number(&kept["square_sigma_mm"][1]) - 0.05 * px / height as f64).abs() < 1e-9, "{kept}");
    let mut said = String::new();
    server.stdout.read_line(&mut said).unwrap();
    server.stdout.read_line(&mut said).unwrap();
    assert_eq!(said, kept["yaml"].as_str().unwrap());
    assert!(said.contains("refresh_hz: 60, panel_px: [800, 480], square_xy_mm: "), "{said}");
    // The next page of this browser knows it.
    chromium.open(&server.url);
    chromium.until("window.cellcal && document.getElementById('facts').textContent.includes('mm')");
    // A card: the field follows the keys.
    chromium.value("document.getElementById('size').click(); document.querySelector('[value=card]').click()");
    let width = "Number(document.querySelector('[name=x_px]').value)";
    // 85.60 mm of 0.1 mm a pixel do not fit 800 pixels.
    assert_eq!(chromium.value(width), json!(856));
    assert!(chromium.value("document.getElementById('how').textContent").as_str().unwrap().contains("does not fit"));
    chromium.value("document.activeElement.blur()");
    chromium.press("ArrowLeft");
    assert_eq!(chromium.value(width), json!(855));
}

#[test]
fn the_server_answers_its_own_page_only_and_survives_everything_else() {
    let server = Server::start(&["cells/handheld.yaml"]);
    let page = server.get("/");
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    assert!(page.contains("content-security-policy: default-src 'none'; script-src 'self'"), "{page}");
    let foreign = server.raw(b"GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n");
    assert!(foreign.starts_with("HTTP/1.1 403") && !foreign.contains("<html"), "{foreign}");
    let origin = format!("origin: {}\r\n", server.url);
    let refused = |answer: String, status: &str| assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{answer}");
    refused(server.post("/api/measured", "", "{}"), "403");
    refused(server.post("/api/measured", "origin: https://evil.example\r\n", "{}"), "403");
    refused(server.post("/api/measured", &origin, "{}"), "422");
    refused(server.post("/api/measured", &origin, "{\"method\""), "400");
    refused(server.post("/api/measured", &origin, &" ".repeat(100_000)), "413");
    let nan = r#"{"method":"card","px":[0,-1],"px_per_square":60,"panel_px":[800,480]}"#;
    refused(server.post("/api/measured", &origin, nan), "400");
    for (path, status) in [
        ("/board.png", "400"),
        ("/board.png?px=99999990", "400"),
        ("/board.png?px=45&squares_x=4294967295&squares_y=4294967295", "400"),
        ("/board.png?px=%ff&state=%00", "400"),
        ("/board.png?px=30&px=45&state=pattern", "200"),
        ("/../../etc/passwd", "404"),
        ("/api/measured", "405"),
    ] {
        refused(server.get(path), status);
    }
    let long = format!("GET /{} HTTP/1.1\r\nHost: localhost\r\n\r\n", "a".repeat(1 << 20));
    for garbage in [&b"\0\0\0\0"[..], b"GET", b"\x16\x03\x01\x02\x00", b"GET / HTTP/1.1\r\n\r\n", long.as_bytes()] {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        // It may hang up in the middle.
        let _ = stream.write_all(garbage);
    }
    refused(server.get("/api/setup"), "200");
}

/// Keeps the certificate that it is shown.
#[derive(Debug)]
struct Shown(Arc<CryptoProvider>, Mutex<String>);

impl ServerCertVerifier for Shown {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        let digest = Sha256::digest(certificate);
        *self.1.lock().unwrap() = digest.iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(":");
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls12_signature(message, certificate, signed, &self.0.signature_verification_algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls13_signature(message, certificate, signed, &self.0.signature_verification_algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.signature_verification_algorithms.supported_schemes()
    }
}

#[test]
fn https_shows_the_certificate_whose_fingerprint_is_printed() {
    let mut server = Server::start(&["cells/handheld.yaml", "--https"]);
    let provider = Arc::new(ring::default_provider());
    let shown = Arc::new(Shown(Arc::clone(&provider), Mutex::default()));
    let config = ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .dangerous()
        .with_custom_certificate_verifier(Arc::clone(&shown) as Arc<dyn ServerCertVerifier>)
        .with_no_client_auth();
    let name = ServerName::try_from("127.0.0.1").unwrap();
    let mut client = ClientConnection::new(Arc::new(config), name).unwrap();
    let mut socket = TcpStream::connect(server.address()).unwrap();
    let mut stream = Stream::new(&mut client, &mut socket);
    stream.write_all(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    // The server hangs up without the farewell of TLS.
    let _ = stream.read_to_end(&mut answer);
    assert!(String::from_utf8_lossy(&answer).contains("cellcal target"));
    // Plain text gets nothing.
    assert!(!server.get("/").contains("cellcal"));
    let _ = server.child.kill();
    let mut said = String::new();
    server.child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(said.contains(shown.1.lock().unwrap().as_str()) && said.contains("SHA-256"), "{said}");
}

#[test]
fn another_device_is_told_what_http_lacks_and_has_it_with_https() {
    let Some(mut chromium) = Chromium::start() else { return };
    for (https, secure) in [(&[][..], false), (&["--https"][..], true)] {
        let server = Server::start(&[&["cells/handheld.yaml", "--name", "bench.test"], https].concat());
        chromium.open(&server.url.replace("127.0.0.1", "bench.test"));
        chromium.until("window.cellcal && cellcal.phase !== 'loading'");
        assert_eq!(chromium.value("isSecureContext"), json!(secure));
        assert_eq!(chromium.value("'wakeLock' in navigator"), json!(secure));
        let missing = chromium.value("document.getElementById('missing').textContent");
        let missing = missing.as_str().unwrap();
        assert_eq!(missing.contains("wake lock"), !secure, "{missing}");
        assert_eq!(missing.contains("start it with --https"), !secure, "{missing}");
        assert_eq!(missing.contains("cellcal target video"), !secure, "{missing}");
    }
}

#[test]
fn a_browser_that_does_not_say_where_its_pixels_are_is_refused_at_a_fractional_scale() {
    // As Safari, which does not know this box.
    let blind = "delete ResizeObserverEntry.prototype.devicePixelContentBoxSize;
      const observe = ResizeObserver.prototype.observe;
      ResizeObserver.prototype.observe = function (element) { return observe.call(this, element); };";
    let server = Server::start(&["cells/handheld.yaml"]);
    for (ratio, phase) in [(1.25, "menu"), (2.0, "held")] {
        let Some(mut chromium) = Chromium::with_screen([800, 480], ratio) else { return };
        chromium.before_pages(blind);
        chromium.open(&format!("{}/?state=a", server.url));
        chromium.until("window.cellcal && cellcal.phase !== 'loading'");
        assert_eq!(chromium.value("cellcal.phase"), json!(phase), "{ratio}");
        let refused = chromium.value("cellcal.message").as_str().unwrap().contains("1.25 device pixels a point");
        assert_eq!(refused, phase == "menu");
    }
}
