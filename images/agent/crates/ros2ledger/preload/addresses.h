/* Which slot an address stands for: read without a lock, written under the ledger's. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

#define NO_SLOT UINT32_MAX

/* The slot of an address, or NO_SLOT. */
uint32_t address_find(const void *address);
/* False if there is no room near the address' place. */
bool address_put(const void *address, uint32_t slot);
/* Forgets every address of a slot. */
void address_forget(uint32_t slot);
void address_forget_all(void);
