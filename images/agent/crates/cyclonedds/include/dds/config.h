/* What the system has, as Cyclone DDS's own build would find it: Linux, with glibc or musl. Names of
 * hosts and plugins are left out, since a static program can't look either up. */
#pragma once
#define DDSRT_HAVE_FILESYSTEM 1
#define DDSRT_HAVE_RUSAGE 1
#define DDSRT_HAVE_GETHOSTNAME 1
#define DDSRT_HAVE_INET_NTOP 1
#define DDSRT_HAVE_INET_PTON 1
#define DDSRT_HAVE_CONDATTR_SETCLOCK 1
