"""A program that is to give back every byte that it is sent: the smallest engine that can judge."""
