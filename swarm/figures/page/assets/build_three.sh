#!/bin/sh
# Makes three.min.js: the parts of three.js that the page uses, with its licence. Needs npm.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm init -y > /dev/null
npm install --silent three@0.187.0 esbuild@0.28.2
node node_modules/esbuild/install.js
used=$(cat "$here"/lives.js "$here"/stage.js "$here"/volume.js | grep -oE 'THREE\.[A-Z][A-Za-z0-9]*' | sed 's/THREE\.//' | sort -u | paste -sd, -)
echo "export { $used } from 'three';" > entry.js
licence=$(printf '/*! three.js 0.187.0, https://threejs.org\n%s\n*/' "$(cat node_modules/three/LICENSE)")
node_modules/.bin/esbuild entry.js --bundle --minify --format=iife --global-name=THREE --target=es2020 \
  --legal-comments=none --banner:js="$licence" --outfile="$here/three.min.js"
