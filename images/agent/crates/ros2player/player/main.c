/* The program. Its standard input is the socket to the agent, by which the memory comes too; it
 * ends when the agent closes it, dies, or sends SIGTERM, whatever its other threads wait for. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include "player.h"

/* Standard output is where libraries write what they like: it goes where errors go. */
static bool arrange_files(void) {
  control_socket = dup(0);
  int nothing = open("/dev/null", O_RDWR);
  if (control_socket < 0 || nothing < 0) return false;
  return dup2(nothing, 0) == 0 && dup2(2, 1) == 1 && close(nothing) == 0;
}

/* The memory's file, which comes with one byte; -1 if none does. */
static int receive_memory(void) {
  char byte;
  union {
    struct cmsghdr head;
    char room[CMSG_SPACE(sizeof(int))];
  } control;
  struct iovec place = {&byte, 1};
  struct msghdr message = {.msg_iov = &place, .msg_iovlen = 1, .msg_control = &control,
                           .msg_controllen = sizeof control};
  ssize_t some;
  do some = recvmsg(control_socket, &message, MSG_CMSG_CLOEXEC);
  while (some < 0 && errno == EINTR);
  struct cmsghdr *first = CMSG_FIRSTHDR(&message);
  if (some != 1 || first == NULL || first->cmsg_type != SCM_RIGHTS) return -1;
  int file;
  memcpy(&file, CMSG_DATA(first), sizeof file);
  return file;
}

/* A file that is readable once the program should end. The kernel signals when the *thread* that
 * started us ends: SIGHUP is for that, and means nothing while its process lives. */
static int watch_signals(void) {
  sigset_t wanted;
  sigemptyset(&wanted);
  sigaddset(&wanted, SIGTERM);
  sigaddset(&wanted, SIGINT);
  sigaddset(&wanted, SIGHUP);
  signal(SIGPIPE, SIG_IGN);
  if (sigprocmask(SIG_BLOCK, &wanted, NULL) != 0) return -1;
  if (prctl(PR_SET_PDEATHSIG, SIGHUP) != 0) return -1;
  return signalfd(-1, &wanted, SFD_CLOEXEC);
}

/* Returns when it is time to end. */
static void wait_for_end(int signals, pid_t agent) {
  struct pollfd files[2] = {{signals, POLLIN, 0}, {control_socket, POLLRDHUP, 0}};
  for (;;) {
    struct signalfd_siginfo signal;
    if (poll(files, 2, -1) < 0 && errno != EINTR) return;
    if (files[1].revents != 0) return;
    if ((files[0].revents & POLLIN) == 0) continue;
    if (read(signals, &signal, sizeof signal) != sizeof signal) return;
    if (signal.ssi_signo != SIGHUP || getppid() != agent) return;
  }
}

int main(void) {
  pid_t agent = getppid();
  int signals = watch_signals();
  if (signals < 0 || !arrange_files()) {
    perror("ros2player");
    return 1;
  }
  int file = receive_memory();
  const char *wrong = file < 0 ? "it did not come" : ring_open(file);
  if (wrong != NULL) {
    fprintf(stderr, "ros2player: its memory can't be used: %s\n", wrong);
    return 1;
  }
  close(file);
  if (!thread_start(control)) return 1;
  wait_for_end(signals, agent);
  end(control_socket);
}
