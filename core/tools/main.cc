#include "core/tools/tools.h"

int main(int argc, char** argv) { return depthtween::tools::Main(argc, argv); }
