/* The type `Fronts` of the module. */

#ifndef PLANNED_H
#define PLANNED_H

#include "arguments.h"

extern PyType_Spec planned_spec;

#endif
