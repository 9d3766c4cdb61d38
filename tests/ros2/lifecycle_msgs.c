/* liblifecycle_msgs__rosidl_generator_c.so, as far as the player uses it. */
#include <stdlib.h>

#include "rmw.h"

struct get_state_response *lifecycle_msgs__srv__GetState_Response__create(void);

struct get_state_response *lifecycle_msgs__srv__GetState_Response__create(void) {
  return calloc(1, sizeof(struct get_state_response));
}
