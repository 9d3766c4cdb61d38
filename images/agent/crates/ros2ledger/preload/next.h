/* The function that an interposed one stands before. */
#pragma once

/* Looks in the libraries after this one, then in `library` where it is loaded (Python loads ROS for
 * itself alone), then in librcl and what that is linked to. NULL where none has the name. */
void *next_function(const char *name, const char *library);
