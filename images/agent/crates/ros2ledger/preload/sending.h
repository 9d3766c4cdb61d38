/* This thread publishes: what it sends meanwhile is a message of ROS 2. */
#pragma once
#include "list.h"

void sending_begin(const struct endpoint_head *publisher);
void sending_end(void);
/* In a child of a fork, which publishes nothing. */
void sending_in_child(void);
