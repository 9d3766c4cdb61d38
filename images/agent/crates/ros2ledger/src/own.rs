//! Which publishers are the reader's own: what a node takes of them counts apart from what it takes of
//! others.

use std::sync::atomic::Ordering::SeqCst;

use crate::layout::{FLAG_REPLACED, OWN, PHASE_DESTROYED, phase};
use crate::{EndpointId, Ledger, LedgerError};

/// How many a ledger has room for: beyond, a look for one that is not there would take long.
const MOST: usize = OWN / 2;

/// FNV-1a (RFC 9923), as the nodes have it (`preload/origin.c`). No key is 0.
fn key(gid: &[u8; 16]) -> u64 {
    let step = |key: u64, byte: &u8| (key ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    gid.iter().fold(0xcbf2_9ce4_8422_2325, step).max(1)
}

impl Ledger {
    /// Counts what is taken of this publisher as the reader's own from now on: before its first message.
    /// `gid` is what the middleware gives as a message's publisher, or its GUID in Cyclone DDS.
    ///
    /// # Errors
    /// [`LedgerError::Full`] if there are 2048.
    pub fn own(&self, gid: &[u8; 16]) -> Result<(), LedgerError> {
        let (key, own) = (key(gid), &self.memory.own);
        if own.iter().filter(|one| one.load(SeqCst) != 0).count() >= MOST {
            return Err(LedgerError::Full { most: MOST });
        }
        for step in 0..OWN as u64 {
            let place = &own[(key.wrapping_add(step) % OWN as u64) as usize];
            match place.compare_exchange(0, key, SeqCst, SeqCst) {
                Ok(_) => return Ok(()),
                Err(has) if has == key => return Ok(()),
                Err(_) => {}
            }
        }
        Err(LedgerError::Full { most: MOST })
    }

    /// Knows none of the reader's publishers any more: those of a player that has ended.
    pub fn disown_all(&self) {
        self.memory.own.iter().for_each(|one| one.store(0, SeqCst));
        self.memory.header.own_published.store(0, SeqCst);
    }

    /// One of them is about to publish: of who subscribes from now on what was kept for it does not count
    /// ([`Endpoint::late`](crate::Endpoint::late)).
    pub fn note_published(&self) {
        let published = &self.memory.header.own_published;
        if published.load(SeqCst) != 0 || published.swap(1, SeqCst) != 0 {
            return;
        }
        // They have taken none of it, so that who takes their place is no less late.
        for slot in &self.memory.endpoint {
            if phase(slot.state.load(SeqCst)) == PHASE_DESTROYED {
                slot.flags.fetch_or(FLAG_REPLACED, SeqCst);
            }
        }
    }

    /// The latest stamp of what this subscription has taken of the reader's publishers, or the one after which
    /// it counts: [`Endpoint::after`](crate::Endpoint::after) of who takes its place now.
    ///
    /// # Errors
    /// [`LedgerError::Retired`].
    pub fn latest(&self, id: EndpointId) -> Result<i64, LedgerError> {
        let slot = self.slot(id)?;
        Ok(slot.own_latest.load(SeqCst).max(slot.own_after.load(SeqCst)))
    }

    /// The node has destroyed this subscription, and none that it creates from now on takes its place
    /// ([`Endpoint::late`](crate::Endpoint::late)).
    ///
    /// # Errors
    /// [`LedgerError::Retired`].
    pub fn end(&self, id: EndpointId) -> Result<(), LedgerError> {
        self.slot(id)?.flags.fetch_or(FLAG_REPLACED, SeqCst);
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn gid(number: u32) -> [u8; 16] {
        std::array::from_fn(|byte| number.to_le_bytes().get(byte).copied().unwrap_or(7))
    }

    #[test]
    fn a_key_is_fnv_1a_of_the_bytes() {
        assert_eq!(key(b"Bagpipe, ROS 2!!"), 0xf57b_bd91_ed27_5fdb);
    }

    #[test]
    fn so_many_publishers_have_room_and_one_counts_once() {
        let ledger = Ledger::new().unwrap();
        let there = || ledger.memory.own.iter().filter(|one| one.load(SeqCst) != 0).count();
        for number in 0..MOST as u32 {
            ledger.own(&gid(number)).unwrap();
            if number < 3 {
                ledger.own(&gid(number)).unwrap();
            }
        }
        assert_eq!(there(), MOST);
        let error = ledger.own(&gid(9999)).unwrap_err();
        assert!(matches!(error, LedgerError::Full { most: 2048 }), "{error}");
        ledger.disown_all();
        assert_eq!(there(), 0);
        ledger.own(&gid(9999)).unwrap();
        assert_eq!(there(), 1);
    }
}
