#include <gtest/gtest.h>
int x_placeholder_modbus_test;
