/* Lets a process send datagrams no faster than others of this machine take them from their sockets. */
#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>

/* Before a datagram of so many bytes goes there: where that is a socket of this machine (IPv4) which has no
 * room for it, waits until it has. For who takes nothing it waits a second, and not again before it takes
 * something; `by_the_clock`, where others wait for what is due next, 20 ms at the most, and a fourth of the
 * time, and for who takes nothing 0.2 s in all. It changes no errno; a signal may interrupt it and send as
 * well, and a thread may be cancelled in it. */
void flow_control_wait(const struct sockaddr *at, socklen_t length, size_t bytes, bool by_the_clock);
void flow_control_wait_message(const struct msghdr *message, bool by_the_clock);
/* In each child of a fork: another thread may have had the lock, and the answers are the parent's. */
void flow_control_in_child(void);
