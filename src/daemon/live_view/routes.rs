//! The addresses of the page.

use std::sync::Arc;

use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Json, Router, middleware};
use serde_json::json;

use super::{Shared, stream};
use crate::daemon::guard::{self, Guard};
use crate::geometry::Camera;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

pub(super) fn router(shared: Arc<Shared>) -> Router {
    let asset =
        |kind: &'static str, text: &'static str| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    Router::new()
        .route("/", asset(HTML, include_str!("page.html")))
        .route("/page.css", asset(CSS, include_str!("page.css")))
        .route("/page.js", asset(SCRIPT, include_str!("page.js")))
        .route("/aids.json", get(aids))
        .route("/rgb.mjpeg", get(|State(shared): State<Arc<Shared>>| async move { images(&shared, Camera::Rgb) }))
        .route("/event.mjpeg", get(|State(shared): State<Arc<Shared>>| async move { images(&shared, Camera::Event) }))
        .fallback(|| async { wrong(StatusCode::NOT_FOUND, "nothing is here; the page is at /") })
        .with_state(shared)
        .layer(middleware::from_fn_with_state(Arc::new(Guard::Shows), guard::guard))
}

fn wrong(status: StatusCode, said: &str) -> Response {
    (status, Json(json!({ "error": said }))).into_response()
}

/// What the page shows beside the images.
async fn aids(State(shared): State<Arc<Shared>>) -> Response {
    let cameras: Vec<_> = shared.cameras.iter().map(|(camera, _)| camera.name()).collect();
    Json(json!({ "cell": shared.cell, "cameras": cameras, "shown": *shared.aids.borrow() })).into_response()
}

fn images(shared: &Shared, camera: Camera) -> Response {
    let Some(sender) = shared.of(camera) else {
        return wrong(StatusCode::NOT_FOUND, "this camera is not shown; see /aids.json");
    };
    let Ok(place) = Arc::clone(&shared.room).try_acquire_owned() else {
        return wrong(StatusCode::SERVICE_UNAVAILABLE, "too many viewers; close another page");
    };
    ([(header::CONTENT_TYPE, stream::TYPE)], stream::body(sender.subscribe(), place)).into_response()
}
