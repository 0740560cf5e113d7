//! Who may ask: only those who call this machine by its own name, and only our own page may post.
//!
//! Other pages in the same browser could otherwise point a name of theirs at this machine and act as us.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};

/// Only our own files, and nothing inline.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HEADERS: [(HeaderName, &str); 6] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// By which names this machine may be asked.
#[derive(Debug, Clone)]
pub(super) struct Guard {
    names: Vec<String>,
    scheme: &'static str,
}

impl Guard {
    pub(super) fn new(names: &[String], https: bool) -> Self {
        let names = names.iter().map(|n| n.to_lowercase()).collect();
        Self { names, scheme: if https { "https" } else { "http" } }
    }

    fn check(&self, method: &Method, headers: &HeaderMap) -> Result<(), String> {
        let mut hosts = headers.get_all(header::HOST).iter();
        let (Some(host), None) = (hosts.next().and_then(|h| h.to_str().ok()), hosts.next()) else {
            return Err("the request names no host; it must name exactly one".into());
        };
        if !self.is_ours(host) {
            return Err(format!(
                "`{host}` is no name of this machine; use its address, localhost, or start with --name {host}"
            ));
        }
        let own = format!("{}://{host}", self.scheme);
        match headers.get(header::ORIGIN) {
            Some(origin) if origin.as_bytes() != own.as_bytes() => Err(format!("only the page at {own} may ask this")),
            None if method != Method::GET && method != Method::HEAD => Err("a post must say its origin".into()),
            Some(_) | None => Ok(()),
        }
    }

    /// An address cannot be pointed elsewhere; of names only our own are.
    fn is_ours(&self, host: &str) -> bool {
        let name = match host.rsplit_once(':') {
            Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
            Some(_) | None => host,
        };
        let unbracketed = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
        let name = name.to_lowercase();
        unbracketed.parse::<IpAddr>().is_ok() || name == "localhost" || self.names.contains(&name)
    }
}

/// Stands before every route.
pub(super) async fn guard(State(guard): State<Arc<Guard>>, request: Request, next: Next) -> Response {
    let mut response = match guard.check(request.method(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(said) => (StatusCode::FORBIDDEN, said).into_response(),
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_our_own_names_are_answered() {
        let guard = Guard::new(&["Bench.local".into()], false);
        for ours in ["127.0.0.1:8765", "[::1]:8765", "[fe80::1]", "localhost", "LOCALHOST:1", "bench.local:8765"] {
            assert!(guard.is_ours(ours), "{ours}");
        }
        for other in ["", ":", "evil.example", "127.0.0.1.evil.example:8765", "localhost.", "[::1", "bench.local:x"] {
            assert!(!guard.is_ours(other), "{other}");
        }
    }

    #[test]
    fn a_post_comes_from_our_own_page() {
        let guard = Guard::new(&[], true);
        let check = |method: &Method, pairs: &[(HeaderName, &'static str)]| {
            let pairs = pairs.iter().map(|(n, v)| (n.clone(), HeaderValue::from_static(v)));
            guard.check(method, &pairs.collect()).is_ok()
        };
        let host = (header::HOST, "10.0.0.5:8765");
        assert!(check(&Method::GET, std::slice::from_ref(&host)));
        assert!(check(&Method::POST, &[host.clone(), (header::ORIGIN, "https://10.0.0.5:8765")]));
        assert!(!check(&Method::POST, std::slice::from_ref(&host)));
        for foreign in ["null", "http://10.0.0.5:8765", "https://evil.example"] {
            assert!(!check(&Method::POST, &[host.clone(), (header::ORIGIN, foreign)]), "{foreign}");
        }
        assert!(!check(&Method::GET, &[]));
    }
}
