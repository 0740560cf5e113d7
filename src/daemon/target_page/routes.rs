//! The addresses of the page.

use std::sync::Arc;

use axum::extract::{DefaultBodyLimit, Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router, middleware};
use serde_json::json;
use tokio::sync::Semaphore;

use super::PageConfig;
use super::measured::Measurement;
use super::wish::{Wish, WishError};
use crate::board::{self, DICTIONARIES};
use crate::cv::{CvError, charuco, codec};
use crate::daemon::guard::{self, Guard};

/// Longest body of a post, bytes.
const BODY: usize = 8192;
/// Images drawn at one time.
const DRAWN_AT_ONCE: usize = 2;

const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

#[derive(Clone)]
struct Page {
    config: Arc<PageConfig>,
    drawing: Arc<Semaphore>,
}

pub(super) fn router(config: Arc<PageConfig>) -> Router {
    let guard = Arc::new(Guard::of_posts(&config.names, config.certificate.is_some()));
    let asset =
        |kind: &'static str, text: &'static str| get(move || async move { ([(header::CONTENT_TYPE, kind)], text) });
    Router::new()
        .route("/", asset(HTML, include_str!("page.html")))
        .route("/page.css", asset(CSS, include_str!("page.css")))
        .route("/page.js", asset(SCRIPT, include_str!("page.js")))
        .route("/rhythm.js", asset(SCRIPT, include_str!("rhythm.js")))
        .route("/surface.js", asset(SCRIPT, include_str!("surface.js")))
        .route("/measure.js", asset(SCRIPT, include_str!("measure.js")))
        .route("/api/setup", get(setup))
        .route("/api/board", get(scale))
        .route("/api/measured", post(measured))
        .route("/board.png", get(image))
        .fallback(|| async { wrong(StatusCode::NOT_FOUND, "nothing is here; the page is at /") })
        .layer(DefaultBodyLimit::max(BODY))
        .with_state(Page { config, drawing: Arc::new(Semaphore::new(DRAWN_AT_ONCE)) })
        .layer(middleware::from_fn_with_state(guard, guard::guard))
}

fn wrong(status: StatusCode, said: impl ToString) -> Response {
    (status, Json(json!({ "error": said.to_string() }))).into_response()
}

type Asked = Query<Vec<(String, String)>>;

impl Page {
    fn wish(&self, asked: &[(String, String)]) -> Result<Wish, WishError> {
        Wish::new(&self.config.board, &self.config.display, asked)
    }
}

/// What the page starts with.
async fn setup(State(page): State<Page>) -> Response {
    let PageConfig { cell, board, display, .. } = page.config.as_ref();
    Json(json!({
        "cell": cell,
        "squares_x": board.squares_x, "squares_y": board.squares_y, "dictionary": board.dictionary,
        // Millimetres that come from binary fractions of a metre.
        "square_mm": (board.square_m * 1e9).round() / 1e6, "marker_mm": (board.marker_m * 1e9).round() / 1e6,
        "alpha": display.alpha, "cycle_hz": display.cycle_hz, "panel_px": display.panel_px,
        "dictionaries": DICTIONARIES,
    }))
    .into_response()
}

/// At which scales a board can be drawn.
async fn scale(State(page): State<Page>, Query(asked): Asked) -> Response {
    match page.wish(&asked) {
        Ok(wish) => Json(json!({ "modules": wish.modules, "step": wish.step })).into_response(),
        Err(error) => wrong(StatusCode::BAD_REQUEST, error),
    }
}

async fn image(State(page): State<Page>, Query(asked): Asked) -> Response {
    let wish = match page.wish(&asked) {
        Ok(wish) => wish,
        Err(error) => return wrong(StatusCode::BAD_REQUEST, error),
    };
    let Some(px) = wish.px else { return wrong(StatusCode::BAD_REQUEST, "px, the pixels a square, is missing") };
    // Never closed.
    let _turn = page.drawing.acquire().await;
    match tokio::task::spawn_blocking(move || draw(&wish, px)).await {
        Ok(Ok(png)) => ([(header::CONTENT_TYPE, "image/png")], png).into_response(),
        Ok(Err(error)) => wrong(StatusCode::INTERNAL_SERVER_ERROR, error),
        Err(error) => wrong(StatusCode::INTERNAL_SERVER_ERROR, error),
    }
}

fn draw(wish: &Wish, px: u32) -> Result<Vec<u8>, CvError> {
    let pattern = board::raster(&wish.board, &charuco::markers(&wish.board)?, px);
    codec::encode_png(&if wish.blended { board::blend_with_white(&pattern, wish.alpha) } else { pattern })
}

/// Takes a measured size; the query says which board was shown.
async fn measured(
    State(page): State<Page>,
    Query(asked): Asked,
    body: Result<Json<Measurement>, axum::extract::rejection::JsonRejection>,
) -> Response {
    let wish = match page.wish(&asked) {
        Ok(wish) => wish,
        Err(error) => return wrong(StatusCode::BAD_REQUEST, error),
    };
    let measurement = match body {
        Ok(Json(measurement)) => measurement,
        Err(rejection) => return wrong(rejection.status(), rejection.body_text()),
    };
    let measured = match measurement.evaluate(&wish) {
        Ok(measured) => measured,
        Err(error) => return wrong(StatusCode::BAD_REQUEST, error),
    };
    let kept = tokio::task::spawn_blocking(move || (page.config.on_measured)(&measured).map(|()| measured)).await;
    match kept {
        Ok(Ok(measured)) => Json(measured).into_response(),
        Ok(Err(said)) => wrong(StatusCode::INTERNAL_SERVER_ERROR, said),
        Err(error) => wrong(StatusCode::INTERNAL_SERVER_ERROR, error),
    }
}
