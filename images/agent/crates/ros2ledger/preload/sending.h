/* This thread publishes: what it sends meanwhile is a message of ROS 2. */
#pragma once

void sending_begin(void);
void sending_end(void);
/* In a child of a fork, which publishes nothing. */
void sending_in_child(void);
