//! Connections of every page: a limited number of them, each with limited time.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;

/// Connections at one time.
const MOST: usize = 64;
/// Time for a handshake, and for the headers of a request.
pub(super) const PATIENCE: Duration = Duration::from_secs(10);
/// Pause when the system has no sockets left.
const EXHAUSTED: Duration = Duration::from_millis(100);

/// How connections are held.
#[derive(Clone)]
pub(super) struct Terms {
    /// Serves https.
    pub(super) tls: Option<TlsAcceptor>,
    /// Time for a handshake, and for the headers of a request.
    pub(super) patience: Duration,
    /// Longest life of a connection; absent: as long as it is answered.
    pub(super) life: Option<Duration>,
    /// Becomes true when nobody new is answered and the last answers are given; absent: never.
    pub(super) stop: Option<watch::Receiver<bool>>,
}

/// Answers until it is told to stop and the last answer is given, or until it is dropped.
pub(super) async fn serve(listener: TcpListener, terms: Terms, router: Router) {
    let room = Arc::new(Semaphore::new(MOST));
    let mut connections = JoinSet::new();
    let mut stop = terms.stop.clone();
    loop {
        let (stream, place) = tokio::select! {
            Some(accepted) = accept(&listener, &room) => accepted,
            () = stopped(&mut stop) => break,
        };
        let (terms, router) = (terms.clone(), router.clone());
        connections.spawn(async move {
            let _place = place;
            match &terms.tls {
                None => answer(stream, &terms, router).await,
                Some(tls) => {
                    // Whoever cannot shake hands is none of ours.
                    if let Ok(Ok(stream)) = timeout(terms.patience, tls.accept(stream)).await {
                        answer(stream, &terms, router).await;
                    }
                }
            }
        });
        while connections.try_join_next().is_some() {}
    }
    drop(listener);
    while connections.join_next().await.is_some() {}
}

/// The next connection, as soon as there is room for it.
async fn accept(listener: &TcpListener, room: &Arc<Semaphore>) -> Option<(TcpStream, OwnedSemaphorePermit)> {
    // Never closed.
    let place = Arc::clone(room).acquire_owned().await.ok()?;
    loop {
        match listener.accept().await {
            Ok((stream, _)) => return Some((stream, place)),
            Err(_) => sleep(EXHAUSTED).await,
        }
    }
}

async fn stopped(stop: &mut Option<watch::Receiver<bool>>) {
    match stop {
        // A sender that is gone means the same.
        Some(stop) => drop(stop.wait_for(|stop| *stop).await),
        None => std::future::pending().await,
    }
}

async fn answer(stream: impl AsyncRead + AsyncWrite + Unpin + Send + 'static, terms: &Terms, router: Router) {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(terms.patience);
    let connection = http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let mut stop = terms.stop.clone();
    let to_its_end = async {
        let mut connection = std::pin::pin!(connection);
        // A connection that broke or took too long is over either way.
        tokio::select! {
            _ = connection.as_mut() => return,
            () = stopped(&mut stop) => connection.as_mut().graceful_shutdown(),
        }
        let _ = connection.await;
    };
    match terms.life {
        Some(life) => drop(timeout(life, to_its_end).await),
        None => to_its_end.await,
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};

    use super::*;

    /// Serves `terms` while a plain client does its part; how long that took.
    fn held(terms: Terms, client: impl FnOnce(std::net::TcpStream) + Send + 'static) -> Duration {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let address = listener.local_addr().unwrap();
            let server = tokio::spawn(serve(listener, terms, Router::new()));
            let began = tokio::time::Instant::now();
            let client = tokio::task::spawn_blocking(move || client(std::net::TcpStream::connect(address).unwrap()));
            timeout(Duration::from_secs(30), client).await.expect("the connection is still held").unwrap();
            server.abort();
            began.elapsed()
        })
    }

    fn until_closed(mut stream: std::net::TcpStream) {
        let mut said = Vec::new();
        // A reset is an end too.
        let _ = stream.read_to_end(&mut said);
    }

    fn terms(life: Option<Duration>) -> Terms {
        Terms { tls: None, patience: Duration::from_millis(200), life, stop: None }
    }

    #[test]
    fn whoever_sends_no_headers_is_let_go() {
        for life in [None, Some(Duration::from_secs(3600))] {
            assert!(held(terms(life), until_closed) >= Duration::from_millis(150));
            let half = |mut stream: std::net::TcpStream| {
                stream.write_all(b"GET / HTTP/1.1\r\nHost: loc").unwrap();
                until_closed(stream);
            };
            assert!(held(terms(life), half) >= Duration::from_millis(150));
        }
    }

    #[test]
    fn a_life_ends_though_its_requests_go_on() {
        let busy = |mut stream: std::net::TcpStream| {
            let mut answer = [0; 4096];
            let ask = b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
            while stream.write_all(ask).is_ok() && matches!(stream.read(&mut answer), Ok(1..)) {}
        };
        assert!(held(terms(Some(Duration::from_millis(300))), busy) >= Duration::from_millis(250));
    }
}
