/* Whether what is sent waits for room in its receivers' sockets. */
#pragma once
#include <stdbool.h>

/* Set by who finds that the middleware is Cyclone DDS. */
extern _Atomic bool holds_back;
