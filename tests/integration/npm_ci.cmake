# cmake -D NPM=.. -D FROM=.. -D TO=.. -P npm_ci.cmake: copies the Node client FROM its source folder TO a build folder and
# installs what package-lock.json pins, unless that very lock file is installed there already.
file(COPY ${FROM}/ DESTINATION ${TO})
file(SHA256 ${TO}/package-lock.json LOCK)
set(STAMP ${TO}/node_modules/.installed)
if(EXISTS ${STAMP})
  file(READ ${STAMP} INSTALLED)
  if(INSTALLED STREQUAL LOCK)
    return()
  endif()
endif()
execute_process(COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund WORKING_DIRECTORY ${TO} COMMAND_ERROR_IS_FATAL ANY)
file(WRITE ${STAMP} ${LOCK})
