"""Text files: conversion of lines to fields, and of fields to the rows of a table."""
