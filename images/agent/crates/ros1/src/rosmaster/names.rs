//! Names of graph resources (<https://wiki.ros.org/Names>).

/// A name without doubled or trailing slashes.
pub(super) fn canonical(name: &str) -> String {
    let parts: Vec<&str> = name.split('/').filter(|part| !part.is_empty()).collect();
    let first = if name.starts_with('/') { "/" } else { "" };
    format!("{first}{}", parts.join("/"))
}

/// The global form of a name that `caller` uses: `/global`, `~private` or relative to the namespace
/// in which the caller is.
pub(super) fn resolve(name: &str, caller: &str) -> String {
    let within = caller.trim_end_matches('/');
    let namespace = within.rfind('/').map_or("", |end| &within[..end]);
    match name.strip_prefix('~') {
        _ if name.starts_with('/') => canonical(name),
        Some(private) => canonical(&format!("{within}/{private}")),
        None => canonical(&format!("{namespace}/{name}")),
    }
}

/// The parts of a global name.
pub(super) fn parts(name: &str) -> impl Iterator<Item = &str> {
    name.split('/').filter(|part| !part.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_global_private_or_relative_to_the_callers_namespace() {
        for (name, caller, global) in [
            ("/a//b/", "/ns/node", "/a/b"),
            ("b", "/ns/node", "/ns/b"),
            ("b/c", "/node", "/b/c"),
            ("~gain", "/ns/node", "/ns/node/gain"),
            ("~/gain", "/node/", "/node/gain"),
            ("/", "/node", "/"),
            ("b", "node", "/b"),
            ("b", "", "/b"),
        ] {
            assert_eq!(resolve(name, caller), global, "{name} of {caller}");
        }
    }
}
