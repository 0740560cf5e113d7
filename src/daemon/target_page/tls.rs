//! A certificate of our own, made at every start and kept in memory only.

use std::sync::Arc;

use rcgen::{CertificateParams, DnType, KeyPair, date_time_ymd};
use sha2::{Digest as _, Sha256};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::{PrivateKeyDer, PrivatePkcs8KeyDer};
use tokio_rustls::rustls::{self, ServerConfig};

/// A day of the calendar.
pub type Day = (i32, u8, u8);

/// Why there is no certificate.
#[derive(Debug, thiserror::Error)]
pub enum CertificateError {
    /// Names or addresses that cannot be in one.
    #[error("certificate: {0}; is every --name a plain host name?")]
    Made(#[from] rcgen::Error),
    /// The TLS library refuses it.
    #[error("certificate: {0}")]
    Used(#[from] rustls::Error),
}

/// A certificate that nobody else has signed: browsers ask once, and show its fingerprint.
pub struct Certificate {
    config: Arc<ServerConfig>,
    /// SHA-256 of the certificate, as browsers write it.
    pub fingerprint: String,
}

impl Certificate {
    /// For these names and addresses; browsers refuse those that are valid for longer than 398 days.
    pub fn new(names: Vec<String>, first_day: Day, last_day: Day) -> Result<Self, CertificateError> {
        let mut parameters = CertificateParams::new(names)?;
        parameters.distinguished_name.push(DnType::CommonName, "cellcal target");
        parameters.not_before = date_time_ymd(first_day.0, first_day.1, first_day.2);
        parameters.not_after = date_time_ymd(last_day.0, last_day.1, last_day.2);
        let key = KeyPair::generate()?;
        let certificate = parameters.self_signed(&key)?.der().clone();
        let digest = Sha256::digest(&certificate);
        let fingerprint = digest.iter().map(|b| format!("{b:02X}")).collect::<Vec<_>>().join(":");
        let key = PrivateKeyDer::from(PrivatePkcs8KeyDer::from(key.serialize_der()));
        let config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()?
            .with_no_client_auth()
            .with_single_cert(vec![certificate], key)?;
        Ok(Self { config: Arc::new(config), fingerprint })
    }

    pub(super) fn acceptor(&self) -> TlsAcceptor {
        TlsAcceptor::from(Arc::clone(&self.config))
    }
}
