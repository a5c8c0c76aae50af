// The steps that bring a database's schema up to date: schema/NNN_*.sql, embedded at build time.
#ifndef DEPTHTWEEN_SERVER_STORE_SCHEMA_H_
#define DEPTHTWEEN_SERVER_STORE_SCHEMA_H_

#include <string>
#include <vector>

namespace depthtween::server {

// In order. A database whose user_version is n has seen the first n.
const std::vector<std::string>& SchemaSteps();

}  // namespace depthtween::server

#endif  // DEPTHTWEEN_SERVER_STORE_SCHEMA_H_
