//! Who may ask: only those who call this machine by an address, or as `localhost`.
//!
//! Other pages in the same browser could otherwise point a name of theirs at this machine and look on.

use std::net::IpAddr;

use axum::extract::Request;
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};

/// Only our own files, and nothing inline.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const HEADERS: [(HeaderName, &str); 5] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Stands before every route.
pub(super) async fn guard(request: Request, next: Next) -> Response {
    let mut response = match check(request.method(), request.headers()) {
        Ok(()) => next.run(request).await,
        Err(said) => (StatusCode::FORBIDDEN, said).into_response(),
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

fn check(method: &Method, headers: &HeaderMap) -> Result<(), String> {
    let mut hosts = headers.get_all(header::HOST).iter();
    let (Some(host), None) = (hosts.next().and_then(|h| h.to_str().ok()), hosts.next()) else {
        return Err("the request names no host; it must name exactly one".into());
    };
    if !is_ours(host) {
        return Err(format!("`{host}` is no name of this machine; use its address, or localhost"));
    }
    if method != Method::GET && method != Method::HEAD {
        return Err(format!("{method} changes things, and here is nothing to change; use GET"));
    }
    Ok(())
}

/// An address cannot be pointed elsewhere.
fn is_ours(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|b| b.is_ascii_digit()) => name,
        Some(_) | None => host,
    };
    let unbracketed = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
    unbracketed.parse::<IpAddr>().is_ok() || name.eq_ignore_ascii_case("localhost")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_addresses_and_localhost_are_answered() {
        for ours in ["127.0.0.1:8766", "[::1]:8766", "[fe80::1]", "localhost", "LOCALHOST:1", "10.0.0.7"] {
            assert!(is_ours(ours), "{ours}");
        }
        for other in ["", ":", "evil.example", "127.0.0.1.evil.example:8766", "localhost.", "[::1", "localhost:x"] {
            assert!(!is_ours(other), "{other}");
        }
    }
}
