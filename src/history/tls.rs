//! TLS to a PostgreSQL server.

use std::sync::Arc;

use rustls::crypto::ring;
use rustls::{ClientConfig, RootCertStore};
use rustls_native_certs::load_native_certs;
use tokio_postgres_rustls::MakeRustlsConnect;

/// Checks the server's certificate and its name against the certificates that the system trusts, or that `SSL_CERT_FILE` or
/// `SSL_CERT_DIR` names.
///
/// # Errors
/// Says that there are none.
pub fn checked() -> Result<MakeRustlsConnect, String> {
    let mut trusted = RootCertStore::empty();
    let found = load_native_certs();
    let (count, _) = trusted.add_parsable_certificates(found.certs);
    if count == 0 {
        let why = found.errors.first().map_or_else(String::new, |error| format!(" ({error})"));
        return Err(format!(
            "no certificate is trusted on this system{why}: name a file of them by SSL_CERT_FILE"
        ));
    }
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|error| error.to_string())?;
    Ok(MakeRustlsConnect::new(config.with_root_certificates(trusted).with_no_client_auth()))
}
