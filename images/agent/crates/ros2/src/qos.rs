//! Quality of service: as it was recorded, as a job wants it, as nodes ask for it.

use bagpipe_graph::TopicInfo;
use bagpipe_log::Connection;
use bagpipe_ros2ledger as ledger;
use bagpipe_ros2player::{Durability, History, Qos, Reliability};

/// A queue of the player's that no subscriber's credit exceeds; what is acknowledged leaves it.
const PLAYED_DEPTH: u32 = 1000;

/// What a job sets of a played topic in place of what was recorded; `None`: as recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QosOverride {
    /// Whether lost messages are sent again.
    pub reliability: Option<Reliability>,
    /// Whether late subscribers get earlier messages.
    pub durability: Option<Durability>,
    /// How many of them.
    pub depth: Option<u32>,
}

/// How a topic is played that several publishers may have offered: as the strongest of them, which
/// suits the subscribers of each. Without a word it is reliable and volatile, as `ros2 topic pub`.
pub(crate) fn played(info: &TopicInfo, wanted: QosOverride) -> Qos {
    let profiles = info.offered_qos.as_deref().map(profiles).unwrap_or_default();
    let best_effort = |profile: &Profile| profile.reliability == Some(Reliability::BestEffort);
    let reliability = if !profiles.is_empty() && profiles.iter().all(best_effort) {
        Reliability::BestEffort
    } else {
        Reliability::Reliable
    };
    let transient = |profile: &Profile| profile.durability == Some(Durability::TransientLocal);
    let durability = if info.latching || profiles.iter().any(transient) {
        Durability::TransientLocal
    } else {
        Durability::Volatile
    };
    let durability = wanted.durability.unwrap_or(durability);
    let depth = match durability {
        Durability::TransientLocal => wanted.depth.unwrap_or_else(|| in_force(info)),
        Durability::Volatile => wanted.depth.unwrap_or(0).max(PLAYED_DEPTH),
    };
    Qos {
        history: History::KeepLast(depth),
        reliability: wanted.reliability.unwrap_or(reliability),
        durability,
    }
}

/// How many messages somebody who comes late would have had of the recorded publishers: as many as a
/// fragment that begins then has of them.
fn in_force(info: &TopicInfo) -> u32 {
    let (datatype, offered_qos) = (info.datatype.clone(), info.offered_qos.clone());
    Connection { datatype, offered_qos, latching: true, ..Connection::default() }.in_force()
}

/// How a topic is recorded: so that it matches each of its publishers, and with all that they keep
/// for who comes late.
pub(crate) fn recorded<'a>(publishers: impl Iterator<Item = &'a ledger::Qos> + Clone) -> Qos {
    let any = |wanted: ledger::Reliability| publishers.clone().any(|qos| qos.reliability == wanted);
    let mut latched = publishers.clone();
    let all_latched = publishers.clone().next().is_some()
        && latched.all(|qos| qos.durability == ledger::Durability::TransientLocal);
    Qos {
        history: History::KeepAll,
        reliability: match any(ledger::Reliability::BestEffort) {
            true => Reliability::BestEffort,
            false => Reliability::Reliable,
        },
        durability: match all_latched {
            true => Durability::TransientLocal,
            false => Durability::Volatile,
        },
    }
}

/// What publishers offer, as ROS 2's recorder writes it down.
pub(crate) fn yaml<'a>(publishers: impl Iterator<Item = &'a ledger::Qos>) -> String {
    publishers.map(profile_yaml).collect()
}

fn profile_yaml(qos: &ledger::Qos) -> String {
    let history = match qos.history {
        ledger::History::KeepLast => "keep_last",
        ledger::History::KeepAll => "keep_all",
        ledger::History::Other(_) => "unknown",
    };
    let reliability = match qos.reliability {
        ledger::Reliability::Reliable => "reliable",
        ledger::Reliability::BestEffort => "best_effort",
        ledger::Reliability::Other(_) => "unknown",
    };
    let durability = match qos.durability {
        ledger::Durability::TransientLocal => "transient_local",
        ledger::Durability::Volatile => "volatile",
        ledger::Durability::Other(_) => "unknown",
    };
    let endless = "{sec: 9223372036, nsec: 854775807}";
    format!(
        "- history: {history}\n  depth: {}\n  reliability: {reliability}\n  durability: \
         {durability}\n  deadline: {endless}\n  lifespan: {endless}\n  liveliness: automatic\n  \
         liveliness_lease_duration: {endless}\n  avoid_ros_namespace_conventions: false\n",
        qos.depth
    )
}

/// Why a subscription can't receive what is played; `None` if it can.
pub(crate) fn incompatible(offered: &Qos, wanted: &ledger::Qos) -> Option<&'static str> {
    let best_effort = offered.reliability == Reliability::BestEffort;
    lacking((best_effort, offered.durability == Durability::Volatile), wanted)
}

/// Whether a subscription may receive what a publisher of the stack offers.
pub(crate) fn reaches(offered: &ledger::Qos, wanted: &ledger::Qos) -> bool {
    let best_effort = offered.reliability == ledger::Reliability::BestEffort;
    lacking((best_effort, offered.durability == ledger::Durability::Volatile), wanted).is_none()
}

/// Messages that a subscription's queue holds; `None` without a bound.
pub(crate) fn depth(wanted: &ledger::Qos) -> Option<u64> {
    match wanted.history {
        ledger::History::KeepLast => Some(wanted.depth.max(1)),
        ledger::History::KeepAll | ledger::History::Other(_) => None,
    }
}

/// How many a subscription takes at the most of those that are kept, in the place of one before it: none,
/// where it does not confirm what it has.
pub(crate) fn given_again(wanted: &ledger::Qos) -> u64 {
    match (wanted.durability, wanted.reliability) {
        (ledger::Durability::TransientLocal, ledger::Reliability::Reliable) => {
            depth(wanted).unwrap_or(u64::MAX)
        }
        _ => 0,
    }
}

/// Whether it asks for what was published before it came.
pub(crate) fn keeps(wanted: &ledger::Qos) -> bool {
    wanted.durability == ledger::Durability::TransientLocal
}

/// What a subscription asks for that what is offered lacks.
fn lacking((best_effort, volatile): (bool, bool), wanted: &ledger::Qos) -> Option<&'static str> {
    if best_effort && wanted.reliability == ledger::Reliability::Reliable {
        Some("it wants reliable messages, and they are played as best effort")
    } else if volatile && wanted.durability == ledger::Durability::TransientLocal {
        Some(
            "it wants what was published before it came (transient local), and they are played as volatile",
        )
    } else {
        None
    }
}

/// Why a recorder that is there already gets nothing of a publisher; `None` if it does.
pub(crate) fn unrecordable(offered: &ledger::Qos, recorded: &Qos) -> Option<&'static str> {
    let best_effort = offered.reliability == ledger::Reliability::BestEffort;
    let volatile = offered.durability == ledger::Durability::Volatile;
    if best_effort && recorded.reliability == Reliability::Reliable {
        Some("as best effort, beside or after a reliable publisher")
    } else if volatile && recorded.durability == Durability::TransientLocal {
        Some("as volatile, beside or after a transient-local publisher")
    } else {
        None
    }
}

/// What one publisher offered, as far as it matters here.
#[derive(Debug, Default, PartialEq)]
struct Profile {
    reliability: Option<Reliability>,
    durability: Option<Durability>,
    depth: u32,
}

/// The profiles of `offered_qos_profiles`, in numbers as until Humble or in words. What is not
/// understood is left out.
fn profiles(yaml: &str) -> Vec<Profile> {
    let mut found = Vec::new();
    for line in yaml.lines() {
        let begins = line.trim_start().starts_with('-');
        if begins {
            found.push(Profile::default());
        }
        let (Some(profile), Some((key, value))) = (found.last_mut(), line.split_once(':')) else {
            continue;
        };
        let value = value.trim().trim_matches(['"', '\'']);
        match key.trim_start().trim_start_matches('-').trim() {
            "reliability" => {
                profile.reliability = match value {
                    "1" | "reliable" => Some(Reliability::Reliable),
                    "2" | "best_effort" => Some(Reliability::BestEffort),
                    _ => None,
                }
            }
            "durability" => {
                profile.durability = match value {
                    "1" | "transient_local" => Some(Durability::TransientLocal),
                    "2" | "volatile" => Some(Durability::Volatile),
                    _ => None,
                }
            }
            "depth" => profile.depth = value.parse().unwrap_or_default(),
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const HUMBLE: &str = "- history: 3\n  depth: 0\n  reliability: 2\n  durability: 2\n";
    const JAZZY: &str = "- history: keep_last\n  depth: 3\n  reliability: \"reliable\"\n  \
                         durability: transient_local\n  deadline:\n    sec: 1\n    nsec: 2\n";

    fn topic(datatype: &str, offered: Option<&str>, latching: bool) -> TopicInfo {
        TopicInfo {
            topic: "/topic".to_owned(),
            datatype: datatype.to_owned(),
            md5sum: String::new(),
            definition: "".into(),
            latching,
            offered_qos: offered.map(str::to_owned),
        }
    }

    fn as_played(offered: &str) -> Qos {
        played(&topic("nav_msgs/msg/Path", Some(offered), false), QosOverride::default())
    }

    #[test]
    fn profiles_are_read_in_numbers_and_in_words() {
        let best_effort = Profile {
            reliability: Some(Reliability::BestEffort),
            durability: Some(Durability::Volatile),
            depth: 0,
        };
        assert_eq!(profiles(HUMBLE), [best_effort]);
        let latched = Profile {
            reliability: Some(Reliability::Reliable),
            durability: Some(Durability::TransientLocal),
            depth: 3,
        };
        assert_eq!(profiles(JAZZY), [latched]);
        for broken in ["", "[]", "depth: 3", ":", "- x", "-\n-\n"] {
            assert!(profiles(broken).iter().all(|one| *one == Profile::default()), "{broken:?}");
        }
    }

    #[test]
    fn the_strongest_of_the_publishers_is_played() {
        let both = as_played(&[HUMBLE, JAZZY].concat());
        assert_eq!(both.reliability, Reliability::Reliable);
        assert_eq!(both.durability, Durability::TransientLocal);
        // Who came late had three messages of the second publisher, and none of the first.
        assert_eq!(both.history, History::KeepLast(3));
        let twice = as_played(&[HUMBLE, JAZZY, JAZZY].concat());
        assert_eq!(twice.history, History::KeepLast(6));
        let weak = as_played(HUMBLE);
        assert_eq!(
            (weak.reliability, weak.durability),
            (Reliability::BestEffort, Durability::Volatile)
        );
        assert_eq!(weak.history, History::KeepLast(PLAYED_DEPTH));
        let unknown = played(&topic("a/B", None, false), QosOverride::default());
        assert_eq!(
            (unknown.reliability, unknown.durability),
            (Reliability::Reliable, Durability::Volatile)
        );
    }

    #[test]
    fn who_comes_late_is_offered_as_many_as_a_fragment_has_in_force() {
        let depth = |datatype: &str, offered: &str| {
            let qos = played(&topic(datatype, Some(offered), true), QosOverride::default());
            assert_eq!(qos.durability, Durability::TransientLocal);
            qos.history
        };
        assert_eq!(depth("nav_msgs/msg/Path", ""), History::KeepLast(1));
        assert_eq!(depth("tf2_msgs/msg/TFMessage", JAZZY), History::KeepLast(100));
        let endless = JAZZY.replace("keep_last", "keep_all");
        assert_ne!(endless, JAZZY);
        assert_eq!(depth("nav_msgs/msg/Path", &endless), History::KeepLast(1000));
        let deep = JAZZY.replace("depth: 3", "depth: 4294967295");
        assert_ne!(deep, JAZZY);
        assert_eq!(depth("nav_msgs/msg/Path", &deep), History::KeepLast(1000));
    }

    #[test]
    fn a_job_has_the_last_word() {
        let wanted = QosOverride {
            reliability: Some(Reliability::BestEffort),
            durability: Some(Durability::TransientLocal),
            depth: Some(7),
        };
        let qos = played(&topic("a/B", Some(JAZZY), false), wanted);
        assert_eq!((qos.reliability, qos.history), (Reliability::BestEffort, History::KeepLast(7)));
        let latched = played(
            &topic("a/B", None, true),
            QosOverride { depth: Some(2), ..QosOverride::default() },
        );
        assert_eq!(
            (latched.durability, latched.history),
            (Durability::TransientLocal, History::KeepLast(2))
        );
    }

    fn asked(reliability: ledger::Reliability, durability: ledger::Durability) -> ledger::Qos {
        ledger::Qos { history: ledger::History::KeepLast, depth: 5, reliability, durability }
    }

    #[test]
    fn the_recorder_matches_every_publisher() {
        use ledger::{Durability as D, Reliability as R};
        let strong = asked(R::Reliable, D::TransientLocal);
        let weak = asked(R::BestEffort, D::Volatile);
        let of = |publishers: &[ledger::Qos]| {
            let qos = recorded(publishers.iter());
            assert_eq!(qos.history, History::KeepAll);
            (qos.reliability, qos.durability)
        };
        assert_eq!(of(&[strong]), (Reliability::Reliable, Durability::TransientLocal));
        assert_eq!(of(&[strong, weak]), (Reliability::BestEffort, Durability::Volatile));
        let of_strong = recorded([strong].iter());
        assert_eq!(unrecordable(&strong, &of_strong), None);
        assert!(unrecordable(&weak, &of_strong).unwrap().contains("best effort"));
        let reliable = asked(R::Reliable, D::Volatile);
        assert!(unrecordable(&reliable, &of_strong).unwrap().contains("as volatile"));
        assert_eq!(unrecordable(&weak, &recorded([strong, weak].iter())), None);
        assert_eq!(of(&[]), (Reliability::Reliable, Durability::Volatile));
        assert_eq!(profiles(&yaml([strong, weak].iter())).len(), 2);
        assert_eq!(profiles(&yaml([strong].iter()))[0].depth, 5);
    }

    #[test]
    fn who_asks_for_more_than_is_offered_is_named() {
        use ledger::{Durability as D, Reliability as R};
        let weak = as_played(HUMBLE);
        let strong = as_played(JAZZY);
        assert!(
            incompatible(&weak, &asked(R::Reliable, D::Volatile)).unwrap().contains("reliable")
        );
        let late = incompatible(&weak, &asked(R::BestEffort, D::TransientLocal)).unwrap();
        assert!(late.contains("transient local"), "{late}");
        assert_eq!(incompatible(&weak, &asked(R::BestEffort, D::Volatile)), None);
        assert_eq!(incompatible(&strong, &asked(R::Reliable, D::TransientLocal)), None);
    }

    #[test]
    fn a_publisher_reaches_who_asks_for_no_more_than_it_offers() {
        use ledger::{Durability as D, Reliability as R};
        let all = [
            (R::Reliable, D::TransientLocal),
            (R::Reliable, D::Volatile),
            (R::BestEffort, D::TransientLocal),
            (R::BestEffort, D::Volatile),
        ];
        let qos = |(reliability, durability)| asked(reliability, durability);
        let reached = all.map(|offered| all.map(|wanted| reaches(&qos(offered), &qos(wanted))));
        assert_eq!(
            reached,
            [
                [true, true, true, true],
                [false, true, false, true],
                [false, false, true, true],
                [false, false, false, true],
            ]
        );
        let other = asked(R::Other(9), D::Other(9));
        assert!(all.iter().all(|one| reaches(&other, &qos(*one)) && reaches(&qos(*one), &other)));
    }
}
