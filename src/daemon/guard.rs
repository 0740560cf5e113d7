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

/// What may be asked of a page, and by which names.
#[derive(Debug, Clone)]
pub(super) enum Guard {
    /// A page that only shows: nothing can be posted, and it is called by an address or as `localhost`.
    Shows,
    /// A page that posts to itself.
    Posts {
        /// Names by which this machine may be asked besides, in lower case.
        names: Vec<String>,
        /// `http` or `https`.
        scheme: &'static str,
    },
}

impl Guard {
    /// Guards a page that posts to itself.
    pub(super) fn of_posts(names: &[String], https: bool) -> Self {
        let names = names.iter().map(|n| n.to_lowercase()).collect();
        Self::Posts { names, scheme: if https { "https" } else { "http" } }
    }

    fn check(&self, method: &Method, headers: &HeaderMap) -> Result<(), String> {
        let mut hosts = headers.get_all(header::HOST).iter();
        let (Some(host), None) = (hosts.next().and_then(|h| h.to_str().ok()), hosts.next()) else {
            return Err("the request names no host; it must name exactly one".into());
        };
        let stranger = |use_instead: &str| Err(format!("`{host}` is no name of this machine; use {use_instead}"));
        let reads = method == Method::GET || method == Method::HEAD;
        match self {
            Self::Shows if !is_ours(host, &[]) => stranger("its address, or localhost"),
            Self::Shows if !reads => Err(format!("{method} changes things, and here is nothing to change; use GET")),
            Self::Shows => Ok(()),
            Self::Posts { names, .. } if !is_ours(host, names) => {
                stranger(&format!("its address, localhost, or start with --name {host}"))
            }
            Self::Posts { scheme, .. } => from_own_page(&format!("{scheme}://{host}"), reads, headers),
        }
    }
}

/// A post must come from our own page, and nothing from another.
fn from_own_page(own: &str, reads: bool, headers: &HeaderMap) -> Result<(), String> {
    match headers.get(header::ORIGIN) {
        Some(origin) if origin.as_bytes() != own.as_bytes() => Err(format!("only the page at {own} may ask this")),
        None if !reads => Err("a post must say its origin".into()),
        Some(_) | None => Ok(()),
    }
}

/// An address cannot be pointed elsewhere; of names only our own are.
fn is_ours(host: &str, names: &[String]) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
        Some(_) | None => host,
    };
    let unbracketed = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
    let name = name.to_lowercase();
    unbracketed.parse::<IpAddr>().is_ok() || name == "localhost" || names.contains(&name)
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

    fn check(guard: &Guard, method: &Method, pairs: &[(HeaderName, &str)]) -> bool {
        let pairs = pairs.iter().map(|(n, v)| (n.clone(), HeaderValue::from_str(v).unwrap()));
        guard.check(method, &pairs.collect()).is_ok()
    }

    #[test]
    fn only_our_own_names_are_answered() {
        let named = Guard::of_posts(&["Bench.local".into()], false);
        let asked = |guard: &Guard, host: &str| check(guard, &Method::GET, &[(header::HOST, host)]);
        for ours in ["127.0.0.1:8765", "[::1]:8765", "[fe80::1]", "localhost", "LOCALHOST:1", "10.0.0.7"] {
            assert!(asked(&named, ours) && asked(&Guard::Shows, ours), "{ours}");
        }
        for other in ["", ":", "evil.example", "127.0.0.1.evil.example:8765", "localhost.", "[::1", "bench.local:x"] {
            assert!(!asked(&named, other) && !asked(&Guard::Shows, other), "{other}");
        }
        assert!(asked(&named, "bench.local:8765") && !asked(&Guard::Shows, "bench.local:8765"));
        assert!(!check(&named, &Method::GET, &[]) && !check(&Guard::Shows, &Method::GET, &[]));
        let mut twice = HeaderMap::new();
        for _ in 0..2 {
            twice.append(header::HOST, HeaderValue::from_static("localhost"));
        }
        assert!(named.check(&Method::GET, &twice).is_err());
    }

    #[test]
    fn nothing_is_posted_to_a_page_that_only_shows() {
        let own = [(header::HOST, "127.0.0.1:8766"), (header::ORIGIN, "http://127.0.0.1:8766")];
        assert!(check(&Guard::Shows, &Method::HEAD, &own));
        assert!(!check(&Guard::Shows, &Method::POST, &own));
    }

    #[test]
    fn a_post_comes_from_our_own_page() {
        let guard = Guard::of_posts(&[], true);
        let check = |method: &Method, pairs: &[(HeaderName, &str)]| check(&guard, method, pairs);
        let host = (header::HOST, "10.0.0.5:8765");
        assert!(check(&Method::GET, std::slice::from_ref(&host)));
        assert!(check(&Method::POST, &[host.clone(), (header::ORIGIN, "https://10.0.0.5:8765")]));
        assert!(!check(&Method::POST, std::slice::from_ref(&host)));
        for foreign in ["null", "http://10.0.0.5:8765", "https://evil.example"] {
            assert!(!check(&Method::POST, &[host.clone(), (header::ORIGIN, foreign)]), "{foreign}");
        }
    }
}
