#include "client/cli/program.h"

int main(int argc, char** argv) { return depthtween::cli::Main(argc, argv); }
