//! Quality of service: as it was recorded, as a job wants it, as nodes ask for it.

mod compatible;
mod profiles;

use std::time::Duration;

use bagpipe_graph::TopicInfo;
use bagpipe_log::Connection;
use bagpipe_ros2ledger as ledger;
use bagpipe_ros2player::{Durability, History, Presence, Qos, Reliability};

pub(crate) use compatible::{incompatible, reaches, unrecordable};
pub(crate) use profiles::yaml;
use profiles::{Profile, profiles};

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
        presence: strongest(profiles.iter().map(|profile| profile.presence)),
    }
}

/// What suits the subscribers of each of these publishers.
fn strongest(all: impl Iterator<Item = Presence>) -> Presence {
    let shorter = |one: Option<Duration>, other| one.into_iter().chain(other).min();
    all.fold(Presence::NONE, |one, other| Presence {
        deadline: shorter(one.deadline, other.deadline),
        lease: shorter(one.lease, other.lease),
        manual: one.manual || other.manual,
    })
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
        presence: Presence::NONE,
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) const HUMBLE: &str = "- history: 3\n  depth: 0\n  reliability: 2\n  durability: 2\n";
    pub(super) const JAZZY: &str = "- history: keep_last\n  depth: 3\n  reliability: \"reliable\"\n  \
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

    pub(super) fn as_played(offered: &str) -> Qos {
        played(&topic("nav_msgs/msg/Path", Some(offered), false), QosOverride::default())
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

    pub(super) fn asked(
        reliability: ledger::Reliability,
        durability: ledger::Durability,
    ) -> ledger::Qos {
        let (history, presence) = (ledger::History::KeepLast, ledger::Presence::NONE);
        ledger::Qos { history, depth: 5, reliability, durability, presence }
    }

    pub(super) fn presence(deadline: Option<u64>, lease: Option<u64>, manual: bool) -> Presence {
        let [deadline, lease] = [deadline, lease].map(|ms| ms.map(Duration::from_millis));
        Presence { deadline, lease, manual }
    }

    #[test]
    fn the_strictest_of_deadlines_and_leases_is_played() {
        let one = "- deadline: {sec: 0, nsec: 100000000}\n";
        let other = "- deadline: {sec: 3, nsec: 0}\n  liveliness: 3\n  liveliness_lease_duration: {sec: 2, nsec: 0}\n";
        assert_eq!(
            as_played(&[one, other].concat()).presence,
            presence(Some(100), Some(2_000), true)
        );
        assert_eq!(as_played(&[HUMBLE, one].concat()).presence, presence(Some(100), None, false));
        assert_eq!(as_played(HUMBLE).presence, Presence::NONE);
    }
}
