/* The type `Fronts` of the module. */

#ifndef FRONTS_TYPE_H
#define FRONTS_TYPE_H

#include "arguments.h"

extern PyType_Spec fronts_spec;

#endif
