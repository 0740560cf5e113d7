//! A receive-only RTDE client of the tests: sees every package, judges nothing.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use cellcal::devices::rtde::{Answer, FieldAnswer, Framer, Recipe, Request, Value};

/// A started connection.
pub(crate) struct Watcher {
    stream: TcpStream,
    framer: Framer,
    recipe: Recipe,
}

impl Watcher {
    /// Connects, waiting up to 10 s for the server, and asks for these fields at 500 Hz.
    pub(crate) fn connect(address: SocketAddr, fields: &[&str]) -> Self {
        let mut stream = (0..100).find_map(|_| {
            let tried = TcpStream::connect(address).ok();
            if tried.is_none() {
                pause(Duration::from_millis(100));
            }
            tried
        });
        let stream = stream.take().unwrap_or_else(|| panic!("nobody listens at {address}"));
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let mut watcher = Self { stream, framer: Framer::default(), recipe: Recipe { id: 0, types: Vec::new() } };
        let names = fields.iter().map(|name| (*name).to_owned()).collect();
        assert_eq!(watcher.ask(&Request::ProtocolVersion(2)), Answer::ProtocolVersion(true));
        let answer = watcher.ask(&Request::SetupOutputs { frequency_hz: 500.0, names });
        let Answer::SetupOutputs { recipe: id, fields } = answer else { panic!("{answer:?}") };
        let typed = |field: &FieldAnswer| match field {
            FieldAnswer::Typed(data_type) => *data_type,
            other => panic!("{other:?}"),
        };
        watcher.recipe = Recipe { id, types: fields.iter().map(typed).collect() };
        assert_eq!(watcher.ask(&Request::Start), Answer::Start(true));
        watcher
    }

    fn ask(&mut self, request: &Request) -> Answer {
        self.stream.write_all(&request.to_bytes().unwrap()).unwrap();
        self.answer()
    }

    fn answer(&mut self) -> Answer {
        loop {
            if let Some(package) = self.framer.next_package().unwrap() {
                return Answer::from_package(package).unwrap();
            }
            let mut bytes = [0; 4096];
            let count = self.stream.read(&mut bytes).unwrap();
            assert!(count > 0, "the controller closed the connection");
            self.framer.push(&bytes[..count]).unwrap();
        }
    }

    /// The values of the next data package.
    pub(crate) fn next(&mut self) -> Vec<Value> {
        loop {
            if let Answer::Data { body, .. } = self.answer() {
                return self.recipe.decode(&body).unwrap();
            }
        }
    }
}

#[expect(clippy::disallowed_methods, reason = "waits for another process")]
pub(crate) fn pause(time: Duration) {
    std::thread::sleep(time);
}
