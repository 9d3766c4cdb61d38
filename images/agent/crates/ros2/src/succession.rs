//! Of a subscription that is gone, and of the one that takes its place.

use std::collections::BTreeMap;

use bagpipe_ros2ledger::{Endpoint, EndpointId, Qos};

use crate::absence::Absence;

/// A subscription that is gone.
#[derive(Debug)]
pub(crate) struct Left {
    /// Messages of ours that it had taken.
    pub(crate) taken: u64,
    /// The latest stamp of these.
    pub(crate) latest: i64,
    /// What had been sent by then.
    pub(crate) sent: u64,
    pub(crate) wanted: Qos,
    pub(crate) away: Absence,
}

/// Whether it is known in whose place one comes, if in any: in that of one with the same quality of service
/// whose latest message it names, and that was seen.
pub(crate) fn is_clear(left: &BTreeMap<EndpointId, Left>, subscription: &Endpoint) -> bool {
    if subscription.late || subscription.after == 0 {
        return true;
    }
    let mut alike = left.values().filter(|left| left.latest == subscription.after);
    let Some(one) = alike.next() else { return false };
    let same = |other: &Left| (other.taken, other.sent) == (one.taken, one.sent);
    one.wanted == subscription.qos && alike.all(same)
}

/// What never comes to a subscription that takes the place of one which had `taken` so many: what lay in
/// the queue of that one, and what was sent to the node while it was away, but for those of all `sent` by now
/// that come `again`. `lost` were given up before.
pub(crate) fn never_comes(taken: u64, (sent, again): (u64, u64), lost: u64) -> u64 {
    sent.saturating_sub(again).saturating_sub(taken).saturating_sub(lost)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_takes_another_s_place_goes_on_where_that_was() {
        // Seven lay in its queue, of which four come again, all of them, or none.
        assert_eq!(never_comes(93, (100, 4), 0), 3);
        assert_eq!(never_comes(93, (100, 50), 0), 0);
        assert_eq!(never_comes(93, (100, 0), 0), 7);
        assert_eq!(never_comes(93, (100, 0), 5), 2);
        // While it was away twenty went out to another one of its node.
        assert_eq!(never_comes(93, (120, 0), 0), 27);
        assert_eq!(never_comes(93, (120, 22), 0), 5);
        assert_eq!(never_comes(93, (120, 12), 0), 15);
        assert_eq!(never_comes(100, (120, 50), 0), 0);
    }
}
