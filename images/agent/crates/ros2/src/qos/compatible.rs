//! Who can receive what is offered: subscriptions of the stack, and our recorder.

use std::time::Duration;

use bagpipe_ros2ledger as ledger;
use bagpipe_ros2player::{Durability, Presence, Qos, Reliability};

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

#[cfg(test)]
mod tests {
    use bagpipe_ros2player::History;

    use super::super::profiles::{profiles, yaml};
    use super::super::recorded;
    use super::super::tests::{HUMBLE, JAZZY, as_played, asked, presence};
    use super::*;

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
