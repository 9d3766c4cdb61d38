//! Quality of service: as it was recorded, as a job wants it, as nodes ask for it.

use std::time::Duration;

use bagpipe_graph::TopicInfo;
use bagpipe_log::Connection;
use bagpipe_ros2ledger as ledger;
use bagpipe_ros2player::{Durability, History, Presence, Qos, Reliability};

/// A queue of the player's that no subscriber's credit exceeds; what is acknowledged leaves it.
const PLAYED_DEPTH: u32 = 1000;

/// What rmw writes of a time without end.
const ENDLESS: Duration = Duration::new(9_223_372_036, 854_775_807);

/// Seconds from which on a recorded time is without end: DDS has 31 bits, as recorders until Galactic wrote.
const LONGEST: u64 = (1 << 31) - 1;

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
    let time = |time: Option<Duration>| {
        let time = time.unwrap_or(ENDLESS);
        format!("{{sec: {}, nsec: {}}}", time.as_secs(), time.subsec_nanos())
    };
    let ledger::Presence { deadline, lease, manual } = qos.presence;
    let liveliness = if manual { "manual_by_topic" } else { "automatic" };
    format!(
        "- history: {history}\n  depth: {}\n  reliability: {reliability}\n  durability: \
         {durability}\n  deadline: {}\n  lifespan: {}\n  liveliness: {liveliness}\n  \
         liveliness_lease_duration: {}\n  avoid_ros_namespace_conventions: false\n",
        qos.depth,
        time(deadline),
        time(None),
        time(lease)
    )
}

/// Why a subscription can't receive what is played; `None` if it can.
pub(crate) fn incompatible(offered: &Qos, wanted: &ledger::Qos) -> Option<&'static str> {
    let best_effort = offered.reliability == Reliability::BestEffort;
    let Presence { deadline, lease, manual } = offered.presence;
    let presence = ledger::Presence { deadline, lease, manual };
    lacking((best_effort, offered.durability == Durability::Volatile, presence), wanted)
}

/// Whether a subscription may receive what a publisher of the stack offers.
pub(crate) fn reaches(offered: &ledger::Qos, wanted: &ledger::Qos) -> bool {
    let best_effort = offered.reliability == ledger::Reliability::BestEffort;
    let volatile = offered.durability == ledger::Durability::Volatile;
    lacking((best_effort, volatile, offered.presence), wanted).is_none()
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
fn lacking(
    (best_effort, volatile, presence): (bool, bool, ledger::Presence),
    wanted: &ledger::Qos,
) -> Option<&'static str> {
    let asked = wanted.presence;
    let longer = |offered: Option<Duration>, wanted: Option<Duration>| {
        wanted.is_some_and(|wanted| offered.is_none_or(|offered| offered > wanted))
    };
    if best_effort && wanted.reliability == ledger::Reliability::Reliable {
        Some("it wants reliable messages, and they are played as best effort")
    } else if volatile && wanted.durability == ledger::Durability::TransientLocal {
        Some(
            "it wants what was published before it came (transient local), and they are played as volatile",
        )
    } else if longer(presence.deadline, asked.deadline) {
        Some("it wants them within a deadline that the recorded publishers did not offer")
    } else if asked.manual && !presence.manual {
        Some(
            "it wants a publisher that shows by itself that it is there, which the recorded were not",
        )
    } else if longer(presence.lease, asked.lease) {
        Some("it wants signs of the publisher more often than the recorded publishers offered")
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
    presence: Presence,
}

/// The profiles of `offered_qos_profiles`, in numbers as until Humble or in words. What is not
/// understood is left out.
fn profiles(yaml: &str) -> Vec<Profile> {
    let mut found: Vec<Profile> = Vec::new();
    // The last key that had no value of its own, whose parts stand in the lines below it.
    let mut above = String::new();
    for line in yaml.lines() {
        if line.trim_start().starts_with('-') {
            found.push(Profile::default());
        }
        let (Some(profile), Some((key, value))) = (found.last_mut(), line.split_once(':')) else {
            continue;
        };
        let key = key.trim_start().trim_start_matches('-').trim();
        let value = value.trim().trim_matches(['"', '\'']);
        match key {
            "sec" | "nsec" => profile.set_time(&above, key, value),
            _ => profile.set(key, value),
        }
        for part in value.trim_matches(['{', '}']).split(',') {
            if let Some((unit, number)) = part.split_once(':') {
                profile.set_time(key, unit.trim(), number.trim());
            }
        }
        if !matches!(key, "sec" | "nsec") {
            key.clone_into(&mut above);
        }
    }
    found.iter_mut().for_each(Profile::end);
    found
}

impl Profile {
    fn set(&mut self, key: &str, value: &str) {
        match key {
            "reliability" => {
                self.reliability = match value {
                    "1" | "reliable" => Some(Reliability::Reliable),
                    "2" | "best_effort" => Some(Reliability::BestEffort),
                    _ => None,
                }
            }
            "durability" => {
                self.durability = match value {
                    "1" | "transient_local" => Some(Durability::TransientLocal),
                    "2" | "volatile" => Some(Durability::Volatile),
                    _ => None,
                }
            }
            "depth" => self.depth = value.parse().unwrap_or_default(),
            "liveliness" => self.presence.manual = matches!(value, "3" | "manual_by_topic"),
            _ => {}
        }
    }

    /// Takes in seconds or nanoseconds of what stands in this key.
    fn set_time(&mut self, key: &str, unit: &str, value: &str) {
        let time = match key {
            "deadline" => &mut self.presence.deadline,
            "liveliness_lease_duration" => &mut self.presence.lease,
            _ => return,
        };
        let more = match unit {
            "sec" => Duration::from_secs(value.parse().unwrap_or(ENDLESS.as_secs())),
            "nsec" => Duration::from_nanos(value.parse().unwrap_or_default()),
            _ => return,
        };
        *time = Some(time.unwrap_or_default().saturating_add(more));
    }

    /// A time that is none, or without end, is not set.
    fn end(&mut self) {
        for time in [&mut self.presence.deadline, &mut self.presence.lease] {
            *time = time.filter(|time| !time.is_zero() && time.as_secs() < LONGEST);
        }
    }
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
            presence: Presence::NONE,
        };
        assert_eq!(profiles(HUMBLE), [best_effort]);
        let latched = Profile {
            reliability: Some(Reliability::Reliable),
            durability: Some(Durability::TransientLocal),
            depth: 3,
            presence: Presence { deadline: Some(Duration::new(1, 2)), ..Presence::NONE },
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
        let (history, presence) = (ledger::History::KeepLast, ledger::Presence::NONE);
        ledger::Qos { history, depth: 5, reliability, durability, presence }
    }

    fn presence(deadline: Option<u64>, lease: Option<u64>, manual: bool) -> Presence {
        let [deadline, lease] = [deadline, lease].map(|ms| ms.map(Duration::from_millis));
        Presence { deadline, lease, manual }
    }

    #[test]
    fn deadline_and_liveliness_are_read_as_each_release_writes_them() {
        let of = |yaml: &str| profiles(yaml).iter().map(|one| one.presence).collect::<Vec<_>>();
        let block = "- deadline:\n    sec: 0\n    nsec: 100000000\n  lifespan:\n    sec: 5\n    nsec: 0\n  \
                     liveliness: 3\n  liveliness_lease_duration:\n    sec: 2\n    nsec: 0\n";
        let inline = "- deadline: {sec: 0, nsec: 100000000}\n  lifespan: {sec: 5, nsec: 0}\n  liveliness: \
                      manual_by_topic\n  liveliness_lease_duration: {nsec: 0, sec: 2}\n";
        let all = presence(Some(100), Some(2_000), true);
        assert_eq!((of(block), of(inline)), (vec![all], vec![all]));
        assert_eq!(of(&[block, HUMBLE].concat()), [all, Presence::NONE]);
        for endless in [
            "{sec: 9223372036, nsec: 854775807}",
            "{sec: 2147483647, nsec: 4294967295}",
            "{sec: 0, nsec: 0}",
            "{sec: 99999999999999999999999, nsec: 0}",
            "{sec: -1}",
            "{}",
            "[]",
            "x: y: z",
        ] {
            let yaml = format!(
                "- deadline: {endless}\n  liveliness_lease_duration: {endless}\n  liveliness: 1\n"
            );
            assert_eq!(of(&yaml), [Presence::NONE], "{endless}");
        }
        assert_eq!(
            of("- deadline: {sec: 2147483646, nsec: 0}\n")[0].deadline.unwrap().as_secs(),
            2147483646
        );
    }

    #[test]
    fn what_publishers_of_the_stack_offer_is_written_and_read_again() {
        use ledger::{Durability as D, Reliability as R};
        for wanted in
            [presence(Some(100), Some(2_000), true), presence(None, Some(1), false), Presence::NONE]
        {
            let Presence { deadline, lease, manual } = wanted;
            let presence = ledger::Presence { deadline, lease, manual };
            let offered = ledger::Qos { presence, ..asked(R::Reliable, D::Volatile) };
            assert_eq!(profiles(&yaml([offered].iter()))[0].presence, wanted);
        }
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

    #[test]
    fn who_asks_for_more_presence_than_is_offered_is_named() {
        use ledger::{Durability as D, Reliability as R};
        let why = |offered: Presence, (deadline, lease, manual)| {
            let offered = Qos { presence: offered, ..as_played(JAZZY) };
            let Presence { deadline, lease, manual } = presence(deadline, lease, manual);
            let presence = ledger::Presence { deadline, lease, manual };
            incompatible(&offered, &ledger::Qos { presence, ..asked(R::Reliable, D::Volatile) })
        };
        let all = presence(Some(100), Some(2_000), true);
        for wanted in [(Some(100), Some(2_000), true), (None, None, false), (Some(101), None, true)]
        {
            assert_eq!(why(all, wanted), None, "{wanted:?}");
        }
        for (wanted, words) in [
            ((Some(99), None, false), "within a deadline"),
            ((None, Some(1_999), false), "signs of the publisher"),
        ] {
            assert!(why(all, wanted).unwrap().contains(words), "{wanted:?}");
            assert!(why(Presence::NONE, wanted).unwrap().contains(words), "{wanted:?}");
        }
        let automatic = presence(Some(100), Some(2_000), false);
        assert!(why(automatic, (None, None, true)).unwrap().contains("shows by itself"));
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
