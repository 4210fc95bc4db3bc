"""The command line: parse the words, call one package, print the result."""
