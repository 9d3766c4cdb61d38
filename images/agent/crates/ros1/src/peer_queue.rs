//! What a subscriber on this machine has not yet read from its socket.
//!
//! The sending side knows only what the peer's *kernel* has taken. A player that must not
//! release the next input before the node has read the last one asks the kernel about the
//! node's own socket, over `sock_diag(7)`: two connection ends on one machine, as in a pod.
//! It costs a few microseconds. Where the peer is on another machine, or the kernel does
//! not answer, the receipt by its kernel is all that can be known.

use std::net::{SocketAddr, SocketAddrV4, TcpStream};
use std::os::fd::OwnedFd;
use std::sync::{Mutex, OnceLock};

use rustix::net::{
    AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, netlink, recv, send, socket_with,
};

use crate::sockets::lock;

/// netlink(7), sock_diag(7): `struct nlmsghdr`, `struct inet_diag_req_v2`, and the places of
/// `idiag_rqueue` and `idiag_inode` in the `struct inet_diag_msg` behind the answer's header.
const HEADER: usize = 16;
const REQUEST: usize = 56;
const SOCK_DIAG_BY_FAMILY: u16 = 20;
const NLM_F_REQUEST: u16 = 1;
const UNREAD: usize = HEADER + 4 + 48 + 4;
const INODE: usize = UNREAD + 12;
const AF_INET: u8 = 2;
const IPPROTO_TCP: u8 = 6;

/// The socket at the other end of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FarSocket {
    /// Bytes that wait in it.
    pub(crate) unread: u64,
    /// Its number, by which /proc/PID/fd names it.
    pub(crate) inode: u32,
}

/// The socket at the other end of `stream`; `None` if nothing can be told of it.
pub(crate) fn far_socket(stream: &TcpStream) -> Option<FarSocket> {
    static KERNEL: OnceLock<Option<Mutex<OwnedFd>>> = OnceLock::new();
    let (SocketAddr::V4(ours), SocketAddr::V4(theirs)) =
        (stream.local_addr().ok()?, stream.peer_addr().ok()?)
    else {
        return None;
    };
    let kernel = KERNEL.get_or_init(|| {
        let kind = (AddressFamily::NETLINK, SocketType::RAW, SocketFlags::CLOEXEC);
        let opened = socket_with(kind.0, kind.1, kind.2, Some(netlink::SOCK_DIAG));
        opened.ok().map(Mutex::new)
    });
    ask(&lock(kernel.as_ref()?), theirs, ours)
}

fn ask(kernel: &OwnedFd, owner: SocketAddrV4, peer: SocketAddrV4) -> Option<FarSocket> {
    send(kernel, &question(owner, peer), SendFlags::DONTWAIT).ok()?;
    let mut answer = [0; 1024];
    // The kernel answers within the send, so that there is nothing to wait for.
    let (length, _) = recv(kernel, &mut answer, RecvFlags::DONTWAIT).ok()?;
    let answer = answer.get(..length)?;
    let kind = u16::from_ne_bytes(*answer.get(4..)?.first_chunk()?);
    let number = |at: usize| Some(u32::from_ne_bytes(*answer.get(at..)?.first_chunk()?));
    let (unread, inode) = (number(UNREAD)?, number(INODE)?);
    (kind == SOCK_DIAG_BY_FAMILY).then_some(FarSocket { unread: unread.into(), inode })
}

fn question(owner: SocketAddrV4, peer: SocketAddrV4) -> [u8; HEADER + REQUEST] {
    let mut bytes = [0; HEADER + REQUEST];
    let mut put = |at: usize, part: &[u8]| bytes[at..at + part.len()].copy_from_slice(part);
    put(0, &((HEADER + REQUEST) as u32).to_ne_bytes());
    put(4, &SOCK_DIAG_BY_FAMILY.to_ne_bytes());
    put(6, &NLM_F_REQUEST.to_ne_bytes());
    put(HEADER, &[AF_INET, IPPROTO_TCP]);
    put(HEADER + 4, &u32::MAX.to_ne_bytes());
    put(HEADER + 8, &owner.port().to_be_bytes());
    put(HEADER + 10, &peer.port().to_be_bytes());
    put(HEADER + 12, &owner.ip().octets());
    put(HEADER + 28, &peer.ip().octets());
    // No interface, and a cookie that means "whichever".
    put(HEADER + 48, &[0xff; 8]);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::TcpListener;

    #[test]
    fn what_the_peer_has_not_read_is_known_to_the_byte_and_its_socket_by_number() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (mut far, _) = listener.accept().unwrap();
        let Some(FarSocket { inode, .. }) = far_socket(&near) else {
            eprintln!("skipped: this kernel does not answer sock_diag");
            return;
        };
        let unread = |stream: &TcpStream| far_socket(stream).map(|far| far.unread);
        let name = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&far));
        let name = std::fs::read_link(name).unwrap();
        assert_eq!(name.to_str().unwrap(), format!("socket:[{inode}]"));
        near.write_all(&[7; 777]).unwrap();
        assert_eq!(unread(&near), Some(777));
        far.read_exact(&mut [0; 700]).unwrap();
        assert_eq!(unread(&near), Some(77));
        far.read_exact(&mut [0; 77]).unwrap();
        assert_eq!(unread(&near), Some(0));
    }
}
