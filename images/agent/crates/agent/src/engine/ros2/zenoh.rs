//! How the processes of a case find each other over Zenoh (`rmw_zenoh_cpp`), where the job leaves that
//! to it: by a router alone, which a stack's image seldom starts. Another middleware ignores all of this.

use std::ffi::{OsStr, OsString};

use crate::engine::nodes::host::PlayerName;

const NAME: &str = "rmw_zenoh_cpp";
const OVERRIDE: &str = "ZENOH_CONFIG_OVERRIDE";
/// How often a process looks for a router before it goes on without; less than 0: it does not look.
const ROUTER_CHECK: &str = "ZENOH_ROUTER_CHECK_ATTEMPTS";
/// Who sets one of these decides on it.
const DECIDES: [&str; 3] = ["ZENOH_SESSION_CONFIG_URI", OVERRIDE, ROUTER_CHECK];
/// Where Zenoh's processes call for each other, as it is; each domain has another port beyond it.
const CALLS: (&str, u16) = ("224.0.0.224", 7446);

/// Has the processes of a domain look for each other on loopback, by calls that no other domain's
/// answer, unless the job or the image (`theirs`) decides.
pub fn variables(
    domain: u16,
    theirs: impl Fn(&str) -> Option<OsString>,
) -> Vec<(&'static str, OsString)> {
    if DECIDES.iter().any(|name| theirs(name).is_some()) {
        return Vec::new();
    }
    let (group, port) = CALLS;
    let settings = [
        "scouting/multicast/enabled=true".to_owned(),
        "scouting/multicast/interface=\"127.0.0.1\"".to_owned(),
        format!("scouting/multicast/address=\"{group}:{}\"", port + domain),
    ];
    vec![(OVERRIDE, settings.join(";").into()), (ROUTER_CHECK, "-1".into())]
}

/// What a fault may come of where the job's middleware is Zenoh; nothing if of something else.
pub fn advice(
    implementation: Option<&OsStr>,
    reason: &str,
    player: Option<PlayerName>,
) -> &'static str {
    match (implementation, reason, player) {
        (Some(name), ..) if name != NAME => "",
        (Some(_), "NeverSubscribed", Some(PlayerName::Dds)) => {
            "; RMW_IMPLEMENTATION is rmw_zenoh_cpp, and the player on DDS meets none of its nodes: \
             let stack.ros2.player be rcl"
        }
        (Some(_), "NeverSubscribed", _) => {
            "; RMW_IMPLEMENTATION is rmw_zenoh_cpp: with settings of your own \
             (ZENOH_SESSION_CONFIG_URI, ZENOH_CONFIG_OVERRIDE, ZENOH_ROUTER_CHECK_ATTEMPTS) its \
             processes find each other as these say, mostly by a router (rmw_zenohd) in the pod"
        }
        _ => "",
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn each_domain_calls_by_a_port_of_its_own_on_loopback() {
        let settings = |domain| {
            let [(name, settings), (check, attempts)] =
                variables(domain, |_| None).try_into().unwrap();
            assert_eq!((name, check, attempts), (OVERRIDE, ROUTER_CHECK, OsString::from("-1")));
            settings.into_string().unwrap()
        };
        assert_eq!(
            settings(1),
            "scouting/multicast/enabled=true;scouting/multicast/interface=\"127.0.0.1\";\
             scouting/multicast/address=\"224.0.0.224:7447\""
        );
        assert!(settings(101).ends_with("\"224.0.0.224:7547\""));
    }

    #[test]
    fn who_has_settings_keeps_them() {
        for own in DECIDES {
            assert_eq!(variables(1, |name| (name == own).then(|| "x".into())), vec![]);
        }
    }

    #[test]
    fn only_what_nobody_subscribed_to_over_zenoh_is_explained_by_it() {
        let zenoh = Some(OsStr::new(NAME));
        let rcl = advice(zenoh, "NeverSubscribed", Some(PlayerName::Rcl));
        assert!(rcl.contains("a router (rmw_zenohd)"), "{rcl}");
        let dds = advice(zenoh, "NeverSubscribed", Some(PlayerName::Dds));
        assert!(dds.ends_with("let stack.ros2.player be rcl"), "{dds}");
        assert_eq!(advice(zenoh, "StackExited", None), "");
        assert_eq!(advice(None, "NeverSubscribed", None), "");
        assert_eq!(advice(Some(OsStr::new("rmw_fastrtps_cpp")), "NeverSubscribed", None), "");
    }
}
