//! Names of topics and nodes.

/// A topic's resolved name: recordings may lack the leading slash.
pub(crate) fn resolved(name: &str) -> String {
    if name.starts_with('/') { name.to_owned() } else { format!("/{name}") }
}
